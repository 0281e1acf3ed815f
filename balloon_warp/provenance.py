"""Provenance of an output, for reproducing it: scenes, hashes of meshes, versions."""

import copy
import hashlib
import inspect
import platform
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from balloon_warp.files import legible
from balloon_warp.kernels.laws import Law
from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene import Scene
from balloon_warp.scene.load import FILES
from balloon_warp.scene.schema import MESHED, WITHOUT_MESHES

LIBRARIES = ("balloon-warp", "warp-lang", "numpy", "scipy", "usd-core")


def describe_scene(scene: Scene) -> dict[str, Any]:
    """Describe a scene as JSON has it. A mesh from Python has its name only."""
    described = scene.model_dump(mode="json", exclude=WITHOUT_MESHES)
    for name in MESHED:
        for table, meshed in zip(described[name], getattr(scene, name), strict=True):
            if meshed.mesh is not None:
                table["mesh"] = mesh_label(meshed.mesh)
    return described


def describe_simulation(scene: Scene, laws: Iterable[Law], substeps: int) -> dict[str, Any]:
    """Describe what is simulated, and by what. Before the run: mesh files may change meanwhile."""
    return {
        "scene": describe_scene(scene),
        "laws": describe_laws(laws),
        "meshes": hash_meshes(meshes_of(scene)),
        "substeps": substeps,
        "versions": installed_versions(),
    }


def meshes_of(scene: Scene) -> list[Path | PolygonMesh]:
    """Return the meshes of balloons, obstacles and bodies."""
    return [each.mesh for name in MESHED for each in getattr(scene, name) if each.mesh is not None]


def without_folders(description: Mapping[str, Any]) -> dict[str, Any]:
    """Describe the same as it is wherever the files are.

    A description has a `scene` and its `meshes`: the names of files lose their folders, and the hashes of meshes are by
    where they stand, as `balloon.0.mesh`.
    """
    scene, hashes = copy.deepcopy(description["scene"]), {}
    for name in MESHED:
        for number, table in enumerate(scene.get(name, ())):
            if "mesh" in table:
                hashes[f"{name}.{number}.mesh"] = description["meshes"][table["mesh"]]
            for file in FILES:
                *within, field = file.split(".")
                holder = table.get(within[0]) if within else table
                if holder and isinstance(holder.get(field), str):
                    holder[field] = Path(holder[field]).name
    return {**description, "scene": scene, "meshes": hashes}


def hash_meshes(meshes: Iterable[str | Path | PolygonMesh]) -> dict[str, str]:
    """Hash each mesh, by its label. Before a run: files may change meanwhile."""
    return {mesh_label(mesh): hash_of_mesh(mesh) for mesh in meshes}


def describe_laws(laws: Iterable[Law]) -> dict[str, dict[str, str]]:
    """Hash each law's functions, as their source has them, by its name (SHA-256)."""
    described = {}
    for law in laws:
        functions = {"force": law.force} | ({"energy": law.energy} if law.energy else {})
        described[law.name] = {what: _hash_of_source(function.func) for what, function in functions.items()}
    return described


def installed_versions() -> dict[str, str]:
    """Return the versions of Python, and of the libraries that a result depends on."""
    installed = {"python": platform.python_version()}
    for library in LIBRARIES:
        try:
            installed[library] = metadata.version(library)
        except metadata.PackageNotFoundError:  # an extra, or a source tree
            continue
    return installed


def hash_of_file(path: Path) -> str:
    """Return SHA-256 of its bytes, in hexadecimal digits, as `sha256sum` prints it."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _hash_of_source(function: Any) -> str:
    return hashlib.sha256(inspect.getsource(function).encode()).hexdigest()


def hash_of_mesh(mesh: str | Path | PolygonMesh) -> str:
    """Return SHA-256 of a mesh's file; of one that came from Python, of its arrays, one after the other."""
    if not isinstance(mesh, PolygonMesh):
        return hash_of_file(Path(mesh))
    arrays = (mesh.points, mesh.face_vertex_counts, mesh.face_vertex_indices)
    return hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)).hexdigest()


def mesh_label(mesh: str | Path | PolygonMesh) -> str:
    """Return a mesh's file, or the name of a mesh made in Python."""
    return mesh.name if isinstance(mesh, PolygonMesh) else legible(str(mesh))

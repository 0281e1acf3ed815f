"""Provenance of an output, for reproducing it, and the summary with which a run or a batch begins."""

import copy
import hashlib
import inspect
import platform
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from balloon_warp.kernels.laws import Law
from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene import Scene
from balloon_warp.scene.load import FILES, files_of
from balloon_warp.scene.schema import MESHED, WITHOUT_MESHES
from balloon_warp.system.files import legible

if TYPE_CHECKING:
    from balloon_warp.model import Model


ABSOLUTE = re.compile(r"(?<![^=,])(?:~[^/=,]*)?/(?:[^/=,]+/)*")
"""Folders of an absolute path, which begins a word or a value in it"""
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
    """Describe the scene and the laws, files and versions it runs with. Before the run: files may change meanwhile."""
    return {
        "scene": describe_scene(scene),
        "laws": describe_laws(laws),
        "files": hash_files(scene),
        "substeps": substeps,
        "versions": installed_versions(),
    }


def hash_files(scene: Scene) -> dict[str, str]:
    """Hash each file that a scene names, and each mesh from Python, by its place, such as `balloon.0.mesh`."""
    hashes = {}
    for name in MESHED:
        for number, table in enumerate(getattr(scene, name)):
            files = files_of(table) | ({"mesh": table.mesh} if isinstance(table.mesh, PolygonMesh) else {})
            hashes |= {f"{name}.{number}.{place}": hash_of_mesh(file) for place, file in files.items()}
    return hashes


def without_folders(description: Mapping[str, Any]) -> dict[str, Any]:
    """Describe the same as it is wherever the files are: those of its `scene` lose their folders."""
    scene = copy.deepcopy(description["scene"])
    for table, field in named_files(scene).values():
        table[field] = Path(table[field]).name
    return {**description, "scene": scene}


def named_files(scene: Mapping[str, Any]) -> dict[str, tuple[dict[str, Any], str]]:
    """Find where a scene as JSON names files: tables and their fields, by places such as `balloon.0.mesh`."""
    found = {}
    for name in MESHED:
        for number, table in enumerate(scene.get(name, ())):
            for file in FILES:
                *within, field = file.split(".")
                holder = table.get(within[0]) if within else table
                if holder and isinstance(holder.get(field), str):
                    found[f"{name}.{number}.{file}"] = holder, field
    return found


def command_without_folders(words: Iterable[str]) -> list[str]:
    """Return the words of a command, of which absolute paths lose their folders."""
    return [ABSOLUTE.sub("", word) for word in words]


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


@dataclass(frozen=True)
class RunHeader:
    """Size of a simulation, its device and its schedule."""

    worlds: int
    particles: int
    """Number of particles of all worlds together"""
    frames: int
    substeps: int
    """Number of substeps in a frame; where meshes differ, of the first"""
    frames_per_second: float
    """Frame rate of the stage [1/s]"""
    device: str
    schedule: str
    workers: int = 1
    """Number of processes that simulate"""
    many_substeps: str | None = None
    """Sentence on the cause of many substeps of a mesh by itself, and its remedy; None if there are few"""
    strain_bound: str | None = None
    """Sentence on film that is softer than its material, and the substeps that this spares; None without such film"""
    coarse: str | None = None
    """Sentence on a mesh by itself whose faces show, and its remedy; else None"""

    @classmethod
    def of(cls, model: "Model", schedule: str) -> Self:
        """Summarize a model before its first frame."""
        from balloon_warp.model.many_substeps import coarse_sentence, many_substeps_sentence
        from balloon_warp.model.strain_bound import strain_bound_sentence

        return cls(
            worlds=model.world_count,
            particles=model.world_count * model.particle_count,
            frames=model.scene.frames,
            substeps=model.substeps,
            frames_per_second=model.scene.frames_per_second,
            device=str(model.device),
            schedule=schedule,
            many_substeps=many_substeps_sentence(model.scene, model.shapes, model.substeps),
            strain_bound=strain_bound_sentence(model),
            coarse=coarse_sentence(model.scene, model.shapes),
        )

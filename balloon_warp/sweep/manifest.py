"""What was simulated, with what, and what came out: `manifest.json`, enough to repeat a batch."""

import hashlib
import json
import platform
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from balloon_warp.mesh import PolygonMesh
from balloon_warp.outputs.files import whole_file
from balloon_warp.sweep.groups import vary_columns
from balloon_warp.sweep.task import BatchTask, Outcome

MANIFEST_NAME = "manifest.json"
LIBRARIES = ("balloon-warp", "warp-lang", "numpy", "scipy", "usd-core")


def describe_batch(task: BatchTask) -> dict[str, Any]:
    """What a batch is made of, as JSON has it. Before the run: mesh files may change meanwhile.

    Of a mesh that came from Python there is the hash of its arrays, and its name.
    """
    scene = task.scene.model_dump(mode="json", exclude={"balloon": {"__all__": {"mesh"}}})
    for said, balloon in zip(scene["balloon"], task.scene.balloon, strict=True):
        said["mesh"] = mesh_label(balloon.mesh)
    columns = {path: column.tolist() for path, column in vary_columns(task.vary).items()}
    varied = [mesh for path in columns if path.endswith(".mesh") for mesh in task.vary[path]]
    meshes = {mesh_label(mesh): mesh for mesh in [*(balloon.mesh for balloon in task.scene.balloon), *varied]}
    return {
        "scene": scene,
        "worlds": task.world_count,
        "vary": columns,
        "export": task.chosen.tolist(),
        "meshes": {label: hash_of_mesh(mesh) for label, mesh in meshes.items()},
    }


def write_manifest(
    task: BatchTask,
    description: Mapping[str, Any],
    provenance: Mapping[str, Any],
    outcome: Outcome,
    names: Iterable[str],
) -> Path:
    """Write the manifest, after the outputs that it names: one that does not fit them is an earlier batch's.

    Args:
        task: what was simulated.
        description: of it, as of `describe_batch`.
        provenance: where its values came from, such as the command and the seed.
        outcome: how it was done.
        names: of the files in the folder.

    Raises:
        InputError: it cannot be written.
    """
    manifest = {
        **provenance,
        "versions": {"python": platform.python_version(), **_versions()},
        "platform": platform.platform(),
        "device": outcome.device,
        "schedule": outcome.schedule,
        "schedule_asked": task.schedule,
        "workers": outcome.workers,
        "healthy_worlds": outcome.healthy_worlds,
        **description,
        "outputs": {name: hash_of_file(task.folder / name) for name in names},
    }
    path = task.folder / MANIFEST_NAME
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")
    return path


def hash_of_file(path: Path) -> str:
    """SHA-256 of its bytes, in hexadecimal digits, as `sha256sum` prints it."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def hash_of_mesh(mesh: str | Path | PolygonMesh) -> str:
    """SHA-256 of a mesh's file; of one that came from Python, of its arrays, one after the other."""
    if not isinstance(mesh, PolygonMesh):
        return hash_of_file(Path(mesh))
    arrays = (mesh.points, mesh.face_vertex_counts, mesh.face_vertex_indices)
    return hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)).hexdigest()


def mesh_label(mesh: str | Path | PolygonMesh) -> str:
    """Its file, or the name of one that came from Python."""
    return mesh.name if isinstance(mesh, PolygonMesh) else str(mesh)


def _versions() -> dict[str, str]:
    installed = {}
    for library in LIBRARIES:
        try:
            installed[library] = metadata.version(library)
        except metadata.PackageNotFoundError:  # an extra, or a source tree
            continue
    return installed

"""A batch, again, from its manifest."""

import json
from pathlib import Path
from typing import Any

from balloon_warp.errors import InputError
from balloon_warp.provenance import hash_of_file
from balloon_warp.scene import Scene
from balloon_warp.sweep.batch import BatchSummary, run_batch


def repeat_batch(manifest: str | Path, folder: str | Path, device: str | None = None) -> BatchSummary:
    """Simulate the batch of a manifest again. Where versions and device are the same, so are the outputs, byte by byte;
    the stage of a cluster's batch, whose shares came in any order, sample by sample.

    Args:
        manifest: the `manifest.json` of the batch. Mesh files are sought where it says, from the current folder.
        folder: where the files go, as in `run_batch`.
        device: a Warp device; the manifest's, when missing, and the default one for a batch of a cluster.

    Raises:
        InputError: the manifest cannot be read, or a mesh is not there, has changed or came from Python; or as
            `run_batch`.
    """
    batch = _read(Path(manifest))
    for path, expected in batch["meshes"].items():
        if not Path(path).is_file():
            raise InputError(f"{manifest}: its mesh {path} is not there; expected a file, as seen from this folder")
        if (found := hash_of_file(Path(path))) != expected:
            raise InputError(f"{path}: has changed since the batch: its SHA-256 is {found}; expected {expected}")
    return run_batch(
        Scene.model_validate(batch["scene"]),
        folder,
        batch["worlds"],
        batch["vary"],
        export=batch["export"],
        name=batch.get("name", ""),
        device=device or (batch["device"] if batch["workers"] == 1 else None),
        schedule=batch["schedule_asked"],
        on_blowup=batch.get("on_blowup", "freeze"),
        provenance={"repeats": str(manifest)},
    )


def _read(path: Path) -> dict[str, Any]:
    try:
        batch = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as a manifest: {error}") from None
    needed = {"scene", "worlds", "vary", "export", "meshes", "device", "workers", "schedule_asked"}
    if not isinstance(batch, dict) or not needed <= batch.keys():
        raise InputError(f"{path}: is not the manifest of a batch; expected the manifest.json beside its table")
    return batch

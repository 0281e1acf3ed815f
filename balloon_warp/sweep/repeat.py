"""A batch, again, from its manifest."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Law
from balloon_warp.provenance import describe_laws, hash_of_file
from balloon_warp.scene import Scene
from balloon_warp.sweep.batch import BatchSummary, run_batch


def repeat_batch(
    manifest: str | Path, folder: str | Path, device: str | None = None, laws: Sequence[Law] = ()
) -> BatchSummary:
    """Simulate the batch of a manifest again.

    Where versions and device are the same, so are the outputs, byte by byte; the stage of a cluster's batch, whose
    shares came in any order, sample by sample.

    Args:
        manifest: the `manifest.json` of the batch. Mesh files are sought where it says, from the current folder.
        folder: where the files go, as in `run_batch`.
        device: a Warp device; the manifest's, when missing, and the default one for a batch of a cluster.
        laws: those of the batch that are not built in.

    Raises:
        InputError: the manifest cannot be read; a mesh is not there, has changed or came from Python; a law is not
            there, or has changed; or as `run_batch`.
    """
    batch = _read(Path(manifest))
    for path, expected in batch["meshes"].items():
        if not Path(path).is_file():
            raise InputError(f"{manifest}: its mesh {path} is not there; expected a file, as seen from this folder")
        if (found := hash_of_file(Path(path))) != expected:
            raise InputError(f"{path}: has changed since the batch: its SHA-256 is {found}; expected {expected}")
    _require_laws(str(manifest), batch.get("laws", {}), describe_laws(laws))
    return run_batch(
        Scene(**batch["scene"]),
        folder,
        batch["worlds"],
        batch["vary"],
        export=batch["export"],
        name=batch.get("name", ""),
        device=device or (batch["device"] if batch["workers"] == 1 else None),
        schedule=batch["schedule_asked"],
        on_blowup=batch.get("on_blowup", "freeze"),
        laws=laws,
        provenance={"repeats": str(manifest)},
    )


def _require_laws(manifest: str, there: dict[str, Any], here: dict[str, Any]) -> None:
    """Make sure that the laws which are given are those of the batch."""
    for name in there.keys() | here.keys():
        if name not in here:
            raise InputError(f"{manifest}: its law {name} is not given; expected it among laws")
        if name not in there:
            raise InputError(f"{manifest}: has no law {name}; expected {', '.join(there) or 'none'}")
        if there[name] != here[name]:
            raise InputError(f"law {name}: its source has changed since the batch of {manifest}")


def _read(path: Path) -> dict[str, Any]:
    try:
        batch = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as a manifest: {error}") from None
    needed = {"scene", "worlds", "vary", "export", "meshes", "device", "workers", "schedule_asked"}
    if not isinstance(batch, dict) or not needed <= batch.keys() or not isinstance(batch["scene"], dict):
        raise InputError(f"{path}: is not the manifest of a batch; expected the manifest.json beside its table")
    return batch

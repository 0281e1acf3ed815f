"""A batch, again, from its manifest."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from balloon_warp.arguments import checked
from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Law
from balloon_warp.provenance import describe_laws, hash_of_file
from balloon_warp.scene import Scene
from balloon_warp.sweep.batch import BatchSummary, run_batch
from balloon_warp.sweep.world_files.options import TrajectoryFiles


@checked
def repeat_batch(
    manifest: str | Path,
    folder: str | Path,
    device: str | None = None,
    laws: Sequence[Law] = (),
    *,
    trajectories: str | Path | None = None,
) -> BatchSummary:
    """Simulate the batch of a manifest again.

    Where versions and device are the same, so are the outputs, byte by byte; the stage of a cluster's batch, whose
    shares came in any order, sample by sample.

    Args:
        manifest: The `manifest.json` of the batch. Its paths of mesh files are relative to the current folder.
        folder: Output folder, as in `run_batch`.
        device: Warp device; the manifest's if not given, and the default one for a batch of a cluster.
        laws: User-defined laws of the batch.
        trajectories: Folder for the batch's files of worlds; they are not written again if not given.

    Raises:
        InputError: the manifest cannot be read; a mesh is not there, has changed or came from Python; a law is not
            there, or has changed; or as `run_batch`.
    """
    batch = _read(Path(manifest))
    for path, expected in batch["meshes"].items():
        if not Path(path).is_file():
            raise InputError(f"{manifest}: its mesh {path} is missing; expected the file, relative to this folder")
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
        table=batch.get("table", "csv"),
        trajectories=_trajectories(manifest, batch.get("trajectories"), trajectories),
        provenance={"repeats": str(manifest)},
    )


def _trajectories(manifest: str | Path, said: Any, folder: str | Path | None) -> TrajectoryFiles | None:
    """Return where files of worlds go, written as the batch did."""
    if folder is None:
        return None
    if not isinstance(said, dict):
        raise InputError(f"{manifest}: has no trajectories; expected those of a batch with --trajectories")
    return TrajectoryFiles(**{**said, "folder": folder})


def _require_laws(manifest: str, there: dict[str, Any], here: dict[str, Any]) -> None:
    """Make sure that the laws which are given are those of the batch."""
    for name in there.keys() | here.keys():
        if name not in here:
            raise InputError(f"{manifest}: its law {name} is missing; expected it in laws")
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

"""A batch, again, from its manifest."""

import json
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from balloon_warp.arguments import checked
from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Law
from balloon_warp.provenance import describe_laws, hash_of_file, named_files
from balloon_warp.scene import Scene, bundled_scenes
from balloon_warp.sweep.batch import BatchSummary, run_batch
from balloon_warp.sweep.groups import SHA256, is_mesh
from balloon_warp.sweep.world_files.options import TrajectoryFiles


@checked
def repeat_batch(
    manifest: str | Path,
    folder: str | Path,
    device: str | None = None,
    laws: Sequence[Law] = (),
    *,
    trajectories: str | Path | None = None,
    files: str | Path | None = None,
) -> BatchSummary:
    """Simulate the batch of a manifest again.

    Where versions and device are the same, so are the outputs, byte by byte; the stage of a cluster's batch, whose
    shares came in any order, sample by sample.

    Args:
        manifest: The `manifest.json` of the batch.
        folder: Output folder, as in `run_batch`.
        device: Warp device; the manifest's if not given, and the default one for a batch of a cluster.
        laws: User-defined laws of the batch.
        trajectories: Folder for the batch's files of worlds; they are not written again if not given.
        files: Folder in which, or below which, meshes and other files of the batch lie. They are known by name and
            hash. If not given, they are taken from the current folder, from that of the manifest or the one above it,
            or from the bundled scenes.

    Raises:
        InputError: the manifest cannot be read; a file is not there, has changed or came from Python; a law is not
            there, or has changed; or as `run_batch`.
    """
    batch = _read(Path(manifest))
    find = _finder(Path(manifest), Path(files) if files is not None else None)
    for place, (table, field) in named_files(batch["scene"]).items():
        table[field] = find(table[field], batch["files"].get(place))
    vary = {path: values for path, values in batch["vary"].items() if not path.endswith(SHA256)}
    for path in filter(is_mesh, vary):
        vary[path] = [find(*of_world) for of_world in zip(vary[path], batch["vary"][f"{path}{SHA256}"], strict=True)]
    _require_laws(str(manifest), batch.get("laws", {}), describe_laws(laws))
    return run_batch(
        Scene(**batch["scene"]),
        folder,
        batch["worlds"],
        vary,
        export=batch["export"],
        name=batch.get("name", ""),
        device=device or (batch["device"] if batch["workers"] == 1 else None),
        schedule=batch["schedule_asked"],
        on_blowup=batch.get("on_blowup", "freeze"),
        laws=laws,
        table=batch.get("table", "csv"),
        trajectories=_trajectories(manifest, batch.get("trajectories"), trajectories),
        provenance={"repeats": hash_of_file(Path(manifest))},
    )


def _finder(manifest: Path, folder: Path | None) -> Callable[[str, str | None], str]:
    """Return a function that finds a file by its name and hash.

    It raises an InputError: the file is nowhere, or has changed.
    """
    bundled = next(iter(bundled_scenes().values())).parent

    @cache
    def find(name: str, expected: str | None) -> str:
        places = [Path(), manifest.parent, manifest.parent.parent, bundled]
        near = (place / name for place in places)
        paths = near if folder is None else sorted(path for path in folder.rglob("*") if path.name == name)
        hashes = {path: hash_of_file(path) for path in paths if path.is_file()}
        for path, digest in hashes.items():
            if digest == expected:
                return str(path)
        for path, digest in hashes.items():
            if path.parent != bundled:  # where another of that name is no change
                raise InputError(f"{path}: has changed since the batch: its SHA-256 is {digest}; expected {expected}")
        raise InputError(
            f"{manifest}: its file {name} is missing; expected it in {folder or 'this folder'}, or another as files"
        )

    return find


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
    needed = {"scene", "worlds", "vary", "export", "files", "device", "workers", "schedule_asked"}
    if not isinstance(batch, dict) or not needed <= batch.keys() or not isinstance(batch["scene"], dict):
        raise InputError(f"{path}: is not the manifest of a batch; expected the manifest.json beside its table")
    return batch

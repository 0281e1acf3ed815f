"""Frames of a batch as they come, into the files of all worlds."""

import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.batch.catalog import (
    MANIFEST_NAME,
    SPLITS,
    STATIC_FOLDER,
    Moments,
    TrajectoryFiles,
    listed_files,
    splits_of,
    write_catalog,
)
from balloon_warp.batch.contents import Contents
from balloon_warp.batch.formats import (
    FORMATS,
    SUFFIX,
    Arrays,
    FileContents,
    WorldFile,
    all_frames,
    make_room,
    put_frames,
)
from balloon_warp.batch.recorder import Group, Record
from balloon_warp.errors import InputError
from balloon_warp.run.checkpoints import JOB_NAME, PartialFolder, as_json
from balloon_warp.system.files import require_ours_in, target_of

BLOCK_BYTES = 2**28
"""Size of the frames that are written together: many small writes would take longer"""
PARTIAL_NAME = "partial"
THREADS = min(os.cpu_count() or 1, 16)
"""Number of files that are compressed at the same time"""


class TrajectoryWriter:
    """Writes the files of worlds into the folder `partial`, from which they move to their places once all are whole.

    Frames of a world may come in any order, and again. A world that blew up repeats its last good frame.

    Args:
        options: where they go, and how.
        contents: of the files.
        groups: the worlds, as they come together.
        job: description of the batch; the same when a batch goes on.

    Raises:
        InputError: the folder cannot be written to, or has files of somebody else; or the disk is too small.
    """

    def __init__(self, options: TrajectoryFiles, contents: Contents, groups: Sequence[Group], job: Mapping[str, Any]):
        self.options, self._contents, self._groups = options, contents, groups
        self.folder = _prepared(Path(options.folder))
        self._partial = PartialFolder(self.folder / PARTIAL_NAME)
        self._partial.require_own()
        self._job = as_json({"trajectories": options.as_json(), **job})
        self._format = FORMATS[options.format]()
        self._statics: dict[str, Arrays] = {}
        """Static fields, by the names of their files"""
        self._commons = self._with_static(contents)
        self.world_count = sum(len(group.worlds) for group in groups)
        self._splits = splits_of(self.world_count, options.seed)
        there = [number for number, split in enumerate(SPLITS) if (self.folder / split).exists()]
        names = map(self._name, np.flatnonzero(np.isin(self._splits, there)).tolist())
        statics = self._statics if (self.folder / STATIC_FOLDER).exists() else ()
        require_ours_in(self.folder, [MANIFEST_NAME, *statics, *names], (MANIFEST_NAME, f"{PARTIAL_NAME}/{JOB_NAME}"))
        self._waiting: list[list[Record]] = [[] for _ in groups]
        self._waiting_bytes = 0
        self._safe = False
        """Whether a checkpoint counts on the frames that are there"""
        _require_disk(self.folder, sum(len(g.worlds) * _size(c) for g, c in zip(groups, self._commons, strict=True)))

    def begin(self, resumed: bool) -> None:
        """Create all files; or go on with those of an earlier batch.

        Raises:
            InputError: they cannot be written, or are not there.
        """
        with self._telling():
            if resumed:
                self._take_up()
                return
            self._partial.begin(self._job)
            for group, common in zip(self._groups, self._commons, strict=True):
                for world in group.worlds.tolist():
                    make_room(self._path(world), common.moving)

    def add(self, group: int, record: Record) -> None:
        """Add a frame of a group."""
        if record.tracks is not None:
            self._waiting[group].append(record)
            self._waiting_bytes += sum(values.nbytes for values in record.tracks.values())
        if self._waiting_bytes >= BLOCK_BYTES:
            self.flush()

    def replace(self, group: int, rows: NDArray[np.integer], record: Record) -> None:
        """Replace a frame of some worlds of a group, by their numbers in it."""
        if record.tracks is not None:
            self.flush()
            with self._telling():
                self._write(group, rows, [record])

    def flush(self) -> None:
        """Write all frames that wait."""
        with self._telling():
            for number, records in enumerate(self._waiting):
                for run in _runs(records, self.options.every):
                    self._write(number, np.arange(len(self._groups[number].worlds)), run)
                records.clear()
        self._waiting_bytes = 0

    def save(self) -> None:
        """Write all frames that wait to the disk, for a checkpoint."""
        self.flush()
        os.sync()
        self._safe = True

    def finish(self, health: NDArray[np.integer]) -> None:
        """Put all files into their places, and the manifest beside them.

        Args:
            health: of each world at the end, shape (world_count,).

        Raises:
            InputError: they cannot be written.
        """
        self.flush()
        with self._telling():
            whole = {name: self._finished_static(name) for name in self._statics}
            worlds = dict(self._finished(health))
            whole |= {self._name(world): path for world, (path, _) in worlds.items()}
            os.sync()
            old = listed_files(self.folder)
            (self.folder / MANIFEST_NAME).unlink(missing_ok=True)  # a folder without one is not whole
            for name in (STATIC_FOLDER, *SPLITS):
                (self.folder / name).mkdir(exist_ok=True)
            for name, path in whole.items():
                _move(path, self.folder / name, self._partial.path)
            for name in old - whole.keys():
                _remove(self.folder / name)
        names, moments = [name for name in whole if name not in self._statics], _together(worlds)
        write_catalog(
            *(self.folder, self.options, self._contents, self._commons[0]),
            *(names, health, list(self._statics), moments),
        )

    def give_up(self) -> None:
        """Remove files that no checkpoint counts on, after a failure."""
        if not self._safe:
            with suppress(InputError):
                self._partial.remove()
            with suppress(OSError):  # there are other files
                self.folder.rmdir()

    def _take_up(self) -> None:
        """Go on with the files of an earlier batch, of which some may be in their places already."""
        if self._partial.job() != self._job:
            raise InputError(
                f"--resume: {self._partial.path} lacks the trajectories of this batch; expected the files written so "
                "far, or no --resume to start over"
            )
        self._partial.go_on()
        self._safe = True
        for group in self._groups:
            for world in group.worlds.tolist():
                if not (path := self._path(world)).exists():
                    raise InputError(f"{path}: is missing; expected the frames of world {world}")

    def _with_static(self, contents: Contents) -> list[WorldFile]:
        """Return the common contents of the files of each group, and note the static arrays that they share."""
        commons: list[WorldFile] = [contents.of_group(group) for group in self._groups]
        known: dict[bytes, str] = {}
        for number in np.argsort([group.worlds[0] for group in self._groups]).tolist():  # the same in any cut
            common = commons[number]
            same = sha256(b"".join(values.tobytes() for _, values in common.static)).digest()
            name = known.setdefault(same, f"{STATIC_FOLDER}/{STATIC_FOLDER}_{len(known):06d}{self._format.suffix}")
            self._statics[name] = common.static
            commons[number] = replace(common, attributes={**common.attributes, STATIC_FOLDER: name})
        return commons

    def _finished_static(self, name: str) -> Path:
        return self._written(name, FileContents({}, self._statics[name]))

    def _finished(self, health: NDArray[np.integer]) -> Iterator[tuple[int, tuple[Path, dict[str, Moments]]]]:
        """Write the files of all worlds, in their order; return them with the moments of those for training."""
        groups = np.zeros(self.world_count, dtype=np.int64)
        for number, group in enumerate(self._groups):
            groups[group.worlds] = number

        def finish(world: int) -> tuple[Path, dict[str, Moments]]:
            contents = self._contents.of_world(self._commons[groups[world]], world, int(health[world]))
            frames = all_frames(self._path(world), contents.moving)
            elsewhere = [field.name for field, _ in contents.static]
            path = self._written(
                self._name(world), FileContents(contents.attributes, [*contents.times, *frames], elsewhere)
            )
            learned = frames if self._splits[world] == SPLITS.index("train") else []
            return path, {field.name: Moments.of(field, values) for field, values in learned}

        with ThreadPoolExecutor(THREADS, thread_name_prefix="packer") as threads:
            yield from enumerate(threads.map(finish, range(self.world_count)))

    def _written(self, name: str, contents: FileContents) -> Path:
        """Write a file beside the frames, and return it."""
        path = self._partial.path / Path(name).name
        _remove(path)  # of a batch that was stopped here
        self._format.write(path, contents)
        return path

    def _write(self, group: int, rows: NDArray[np.integer], records: Sequence[Record]) -> None:
        """Write frames that follow each other."""
        moving = self._commons[group].moving
        begin = records[0].number // self.options.every
        health = np.stack([record.healthy for record in records]).astype(np.int32)
        for place, row in enumerate(rows.tolist()):
            path = self._path(int(self._groups[group].worlds[row]))
            arrays = {"health": health[:, place]}
            for field in moving[:-1]:
                arrays[field.name] = np.stack([(record.tracks or {})[field.name][place] for record in records])
            bad = np.flatnonzero(arrays["health"] == 0)
            if len(bad):
                _freeze(arrays, all_frames(path, moving), begin, int(bad[0]))
            put_frames(path, moving, begin, arrays)

    def _path(self, world: int) -> Path:
        return self._partial.path / f"world_{world:06d}{SUFFIX}"

    def _name(self, world: int) -> str:
        return f"{SPLITS[self._splits[world]]}/world_{world:06d}{self._format.suffix}"

    @contextmanager
    def _telling(self) -> Iterator[None]:
        """Tell of a file that cannot be written in a sentence."""
        try:
            yield
        except OSError as error:
            reason = error.strerror or str(error).partition("\n")[0]
            raise InputError(f"{self.folder}: trajectories cannot be written: {reason}") from None


def remove_partial(options: TrajectoryFiles | None) -> None:
    """Remove the files for a resumption, once all of the batch is there."""
    if options:
        PartialFolder(Path(options.folder) / PARTIAL_NAME).remove()


def _prepared(folder: Path) -> Path:
    """Return the folder, which is made if it is not there."""
    try:
        folder = target_of(folder)
        folder.mkdir(exist_ok=True)
        if not os.access(folder, os.W_OK | os.X_OK):
            raise InputError(f"{folder}: cannot be written: Permission denied")
    except FileNotFoundError:
        raise InputError(f"{folder}: the folder {folder.parent} does not exist") from None
    except (FileExistsError, NotADirectoryError):
        raise InputError(f"{folder}: is a file; expected a folder") from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}") from None
    return folder


def _require_disk(folder: Path, needed: int) -> None:
    if needed > (free := shutil.disk_usage(folder).free):
        raise InputError(
            f"{folder}: the trajectories need {needed / 2**30:.2f} GiB, and the disk has {free / 2**30:.2f} GiB; "
            "expected more room, fewer worlds or a larger --every"
        )


def _size(world: WorldFile) -> int:
    """Return the size of a world's frames, and that of its file, which compression makes smaller by an unknown part."""
    return 2 * sum(field.bytes for field in world.moving)


def _together(worlds: Mapping[int, tuple[Path, dict[str, Moments]]]) -> dict[str, Moments]:
    """Return the moments of all worlds that have them."""
    total: dict[str, Moments] = {}
    for _, moments in worlds.values():
        for name, more in moments.items():
            total[name] = total[name].with_more(more) if name in total else more
    return total


def _runs(records: Sequence[Record], every: int) -> Iterator[list[Record]]:
    """Split records where one does not follow the one before."""
    run: list[Record] = []
    for record in records:
        if run and record.number != run[-1].number + every:
            yield run
            run = []
        run.append(record)
    if run:
        yield run


def _freeze(arrays: Mapping[str, NDArray], frames: Arrays, begin: int, bad: int) -> None:
    """Repeat the last good frame from a bad one on."""
    for field, written in frames[:-1]:
        values = arrays[field.name]
        if bad:
            values[bad:] = values[bad - 1]
        else:
            values[:] = written[begin - 1] if begin else 0.0


def _move(path: Path, place: Path, aside: Path) -> None:
    """Move a file or folder to its place, where there may be an earlier one."""
    if path.is_dir() and place.exists():
        place.rename(aside / f"earlier_{place.name}")
    os.replace(path, place)


def _remove(path: Path) -> None:
    with suppress(OSError):
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)

"""Checkpoints of an unfinished batch: parts of its table and its stage, and the state at their end."""

import time
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.outputs.npz import write_npz
from balloon_warp.provenance import installed_versions
from balloon_warp.resume import PartialFolder, as_json, differences
from balloon_warp.sweep.output import BatchOutput
from balloon_warp.sweep.resume.parts import Part, read_part, write_rows
from balloon_warp.sweep.task import BatchTask

if TYPE_CHECKING:
    from balloon_warp.outputs.usd.grid import GridWriter

PARTIAL_NAME, PLAYLIST, STILL = "partial", "worlds.usda", "still.usdc"


class BatchCheckpoints:
    """Keeps a batch safe as it goes.

    A checkpoint is a part of the table, `rows_NUMBER.npz`, that of the stage which goes with it, `worlds_NUMBER.usdc`,
    and where each group's simulation goes on, `state_FRAME_GROUP.npz`; `worlds.usda` plays all of them.

    Each file appears whole, a part's rows last: a part without them is no part, and a state that no rows lead up to is
    not gone on from.

    Args:
        task: the batch.
        description: of it, as of `describe_batch`.
        seconds: between two checkpoints; 0 for none but the last of a batch that is stopped.
        resume: whether to go on from those that are there.
        on_note: told what is there, in a sentence.
    """

    def __init__(
        self,
        task: BatchTask,
        description: Mapping[str, Any],
        seconds: float,
        resume: bool,
        on_note: Callable[[str], None],
    ):
        self.seconds, self.resume, self.on_note = seconds, resume, on_note
        self.folder = PartialFolder(task.folder / PARTIAL_NAME)
        self._job: dict[str, Any] = {
            **description,
            "substeps": task.groups[0].plan.substeps,
            "on_blowup": task.on_blowup,
            "trajectories": task.trajectories.as_json() if task.trajectories else None,
            "versions": installed_versions(),
        }
        self._begun = False
        """Whether the folder belongs to this batch"""
        self._begins: list[int] = []
        """First frame of each part"""
        self._scene = task.scene
        self._saved_at = time.monotonic()

    def take_up(self, output: BatchOutput, **how: Any) -> Iterator[Part]:
        """Put the saved parts into the output, one by one, in the order in which they were saved.

        Args:
            how: Place and schedule of the simulation, on which its bits depend besides its description.

        Raises:
            InputError: It is of another batch, or is damaged, or something else is in its place.
        """
        self._job = as_json({**self._job, **how})
        self.folder.require_own()
        path, is_there = self.folder.path, self._rows.exists()
        self.folder.clear(is_there)
        if not self.resume:
            if is_there:
                self.on_note(
                    f"{path} has part of an earlier batch, from which --resume would have gone on; it is kept as "
                    f"{self.folder.aside.name} until this one is done"
                )
            return
        if not is_there:
            self.on_note(f"there is no checkpoint in {path}: nothing to resume, so this begins at the start")
            return
        if different := list(differences(self.folder.job(), self._job)):
            more = f", and {len(different) - 1} more" if len(different) > 1 else ""
            raise InputError(
                f"--resume: {path} is of another batch: {different[0]}{more}; expected the same worlds, versions and "
                "device, or no --resume to start anew"
            )
        self.folder.go_on()
        self._begun = True
        while self._rows.exists():
            part = read_part(output, self._rows, self._stage)
            self._begins.append(part.frames.start)
            yield part

    def restore(self, frame: int, group: int, *restores: Callable[[Mapping[str, NDArray]], None]) -> None:
        """Hand over the arrays of a group that were saved with a frame.

        Raises:
            InputError: they are not there, or damaged.
        """
        path = self._state(frame, group)
        try:
            with np.load(path) as saved:
                for restore in restores:
                    restore(saved)
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
            raise InputError(f"{path}: cannot be read: {error}; expected a checkpoint") from None

    @property
    def due(self) -> bool:
        """Return whether the last checkpoint was long ago."""
        return self.seconds > 0.0 and time.monotonic() - self._saved_at >= self.seconds

    @property
    def advice(self) -> str:
        """Advice to a user without the output."""
        if not self._begun:
            return "nothing was written"
        return f"{self.folder.path} has what there is, and --resume goes on from it"

    def save_state(self, frame: int, group: int, arrays: Iterable[tuple[str, NDArray]]) -> None:
        """Save where the simulation of a group is, before the rows that lead up to it.

        Raises:
            InputError: it cannot be written; what was there stays.
        """
        self._begin()
        with self.folder.file(self._state(frame, group).name) as path:
            write_npz(path, arrays)

    def save_part(self, output: BatchOutput, part: Part) -> None:
        """Save a part of what is in the output; states of earlier frames are not needed any more.

        Raises:
            InputError: it cannot be written; what was there stays.
        """
        self._begin()
        begins = [*self._begins, part.frames.start]
        if output.stage:
            output.stage.write_part(self._stage, part.frames, part.groups)
            self._write_playlist(output.stage, begins, part.frames[-1])
        write_rows(output, part, self._rows)
        self._begins = begins
        for state in self.folder.path.glob("state_*.npz"):
            if int(state.stem.split("_")[1]) < part.frames[-1]:
                state.unlink(missing_ok=True)
        self._saved_at = time.monotonic()  # what takes long to save is saved less often

    def remove(self) -> None:
        """Remove the checkpoints once the whole output exists; those of another batch stay."""
        if self._begun:
            self.folder.remove()

    def _begin(self) -> None:
        if not self._begun:
            self.folder.begin(self._job)
            self._begun = True
        self._saved_at = time.monotonic()

    def _write_playlist(self, stage: "GridWriter", begins: Sequence[int], last: int) -> None:
        """Write a stage of all parts: one after the other, or, of shares, which begin alike, together."""
        from balloon_warp.outputs.usd.playlist import write_overlay, write_playlist  # loads USD: only for a stage

        if not (still := self.folder.path / STILL).exists():
            stage.write_still(still)
        names = [_stage_name(number) for number in range(len(begins))]
        with self.folder.file(PLAYLIST) as path:
            if len(set(begins)) == len(begins):
                write_playlist(path, STILL, list(zip(begins, names, strict=True)), last, self._scene)
            else:
                write_overlay(path, STILL, names, last, self._scene)

    @property
    def _rows(self) -> Path:
        """Path of the next part's rows."""
        return self.folder.path / f"rows_{len(self._begins):06d}.npz"

    @property
    def _stage(self) -> Path:
        """Path of the next part's stage."""
        return self.folder.path / _stage_name(len(self._begins))

    def _state(self, frame: int, group: int) -> Path:
        return self.folder.path / f"state_{frame:06d}_{group:04d}.npz"


def _stage_name(part: int) -> str:
    return f"worlds_{part:06d}.usdc"

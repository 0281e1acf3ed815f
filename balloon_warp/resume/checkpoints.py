"""Checkpoints of an unfinished job: parts of its output, and the states that they end with."""

import json
import time
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.outputs.npz import write_npz
from balloon_warp.resume.folder import PartialFolder
from balloon_warp.resume.part import Output, Part
from balloon_warp.resume.same_job import as_json, differences
from balloon_warp.scene import Scene

if TYPE_CHECKING:
    from balloon_warp.outputs.usd.growing import GrowingStage

CHECKPOINT_SECONDS = 30.0
"""Time between two checkpoints [s]: the most that a kill costs"""
PLAYLIST, STILL = "frames.usda", "still.usdc"


class Checkpoints:
    """Keeps a job safe as it goes: a run, or a batch.

    A checkpoint is where the simulation of each group goes on, `state_FRAME_GROUP.npz`, the part of the stage since the
    last, `frames_NUMBER.usdc`, and the rows beside it, `rows_NUMBER.npz`; `frames.usda` plays all of them.

    Each file appears whole, a part's rows last: a part without them is no part, and a state that no rows lead up to is
    not gone on from.

    Args:
        folder: where they are, or will be.
        kind: of the job, in sentences: "run" or "batch".
        job: the inputs that decide the bits of the job.
        scene: of the stage.
        seconds: between two checkpoints; 0 for none but the last of a job that is stopped.
        resume: whether to go on from those that are there.
        on_note: called with a sentence on the checkpoints that are there.
    """

    def __init__(
        self,
        folder: Path,
        kind: str,
        job: Mapping[str, Any],
        scene: Scene,
        *,
        seconds: float = CHECKPOINT_SECONDS,
        resume: bool = False,
        on_note: Callable[[str], None] = lambda sentence: None,
    ):
        self.seconds, self.resume, self.on_note = seconds, resume, on_note
        self.folder = PartialFolder(folder)
        self._kind, self._job, self._scene = kind, dict(job), scene
        self._begun = False
        """Whether the folder belongs to this job"""
        self._begins: list[int] = []
        """First frame of each part"""
        self._saved_at = time.monotonic()

    def take_up(self, output: Output, **how: Any) -> Iterator[Part]:
        """Put the saved parts into the output, one by one, in the order in which they were saved.

        Args:
            how: Place and schedule of the simulation, on which its bits depend besides its description.

        Raises:
            InputError: It is of another job, or is damaged, or something else is in its place.
        """
        self._job = as_json({**self._job, **how})
        self.folder.require_own()
        path, is_there = self.folder.path, self._rows.exists()
        self.folder.clear(is_there)
        if not self.resume:
            if is_there:
                self.on_note(
                    f"{path} holds an earlier {self._kind} that --resume would continue; it is kept as "
                    f"{self.folder.aside.name} until this {self._kind} is done"
                )
            return
        if not is_there:
            self.on_note(f"no checkpoint in {path} to resume from: starting from the beginning")
            return
        if different := list(differences(self.folder.job(), self._job)):
            more = f", and {len(different) - 1} more" if len(different) > 1 else ""
            raise InputError(
                f"--resume: {path} belongs to another {self._kind}: {different[0]}{more}; expected the same inputs, "
                "versions and device, or no --resume to start over"
            )
        self.folder.go_on()
        self._begun = True
        while self._rows.exists():
            part = self._read_part(output)
            self._begins.append(part.frames.start)
            yield part

    def restore(self, begin: int, restores: Sequence[Callable[[Mapping[str, NDArray]], None]]) -> None:
        """Hand each group the arrays that were saved with the frame before the first that is missing.

        Raises:
            InputError: they are not there, or damaged.
        """
        if begin == 0:
            return
        for group, restore in enumerate(restores):
            with _reading(path := self._state(begin - 1, group), "a checkpoint"), np.load(path) as saved:
                restore(saved)
        self.on_note(f"resuming after frame {begin - 1}, from {self.folder.path}")

    @property
    def due(self) -> bool:
        """Return whether the last checkpoint was long ago."""
        return self.seconds > 0.0 and time.monotonic() - self._saved_at >= self.seconds

    @property
    def advice(self) -> str:
        """Advice to a user without the output."""
        if not self._begun:
            return "nothing was written"
        if (playlist := self.folder.path / PLAYLIST).exists():
            return f"{playlist} plays the frames so far, and --resume continues from them"
        return f"{self.folder.path} holds the frames so far, and --resume continues from them"

    def save_state(self, frame: int, group: int, arrays: Iterable[tuple[str, NDArray]]) -> None:
        """Save where the simulation of a group is, before the rows that lead up to it.

        Raises:
            InputError: it cannot be written; earlier files stay.
        """
        self._begin()
        with self.folder.file(self._state(frame, group).name) as path:
            write_npz(path, arrays)

    def save_part(self, output: Output, part: Part) -> None:
        """Save a part of the output; states of earlier frames are not needed any more.

        Raises:
            InputError: it cannot be written; earlier files stay.
        """
        self._begin()
        begins = [*self._begins, part.frames.start]
        if output.stage:
            output.stage.write_part(self._stage, part.frames, part.groups)
            self._write_playlist(output.stage, begins, part.frames[-1])
        arrays = {
            "frames": np.array(part.frames, dtype=np.int32),
            "groups": np.array(part.groups, dtype=np.int32),
            "notes": np.array(json.dumps(part.notes)),
            **output.rows(part),
        }
        with self.folder.file(self._rows.name) as path:
            write_npz(path, arrays.items())
        self._begins = begins
        for state in self.folder.path.glob("state_*.npz"):
            if int(state.stem.split("_")[1]) < part.frames[-1]:
                state.unlink(missing_ok=True)
        self._saved_at = time.monotonic()  # a slow checkpoint is written less often

    def remove(self) -> None:
        """Remove the checkpoints once the whole output exists; those of another job stay."""
        if self._begun:
            self.folder.remove()

    def _begin(self) -> None:
        if not self._begun:
            self.folder.begin(self._job)
            self._begun = True
        self._saved_at = time.monotonic()

    def _read_part(self, output: Output) -> Part:
        """Copy the next part into an output, of the stage, too, if there is one."""
        with _reading(self._rows, f"a part of a {self._kind}"), np.load(self._rows) as saved:
            frames = range(int(saved["frames"][0]), int(saved["frames"][-1]) + 1)
            part = Part(frames, saved["groups"].tolist(), json.loads(str(saved["notes"])))
            output.take_rows(part, saved)
        if output.stage:
            output.stage.copy_part(self._stage, part.frames, part.groups)
        return part

    def _write_playlist(self, stage: "GrowingStage", begins: Sequence[int], last: int) -> None:
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
    return f"frames_{part:06d}.usdc"


@contextmanager
def _reading(path: Path, what: str) -> Iterator[None]:
    """Name the expected content where a file is damaged or not there.

    Raises:
        InputError: it is.
    """
    try:
        yield
    except (OSError, ValueError, KeyError, IndexError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: cannot be read: {error}; expected {what}") from None

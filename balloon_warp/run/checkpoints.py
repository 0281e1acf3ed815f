"""Checkpoints of long jobs: how they survive a kill, and resume to the same bytes.

While a run or a batch is at work, now and then it writes a checkpoint into a folder beside its output: the state from
which it goes on, then the output since the last one. Each file appears whole, in an order in which a kill
between any two leaves a checkpoint that is good. With `--resume` the same command finds the folder, makes sure that it
is of the same job, takes up its frames, and simulates the rest. Once the output is whole, the folder goes.
"""

import json
import os
import time
import weakref
import zipfile
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from balloon_warp.blow_ups import MOST_HALVINGS
from balloon_warp.errors import InputError
from balloon_warp.frame import Frame
from balloon_warp.model.stability import strain_bound_described
from balloon_warp.run.report import describe_simulation
from balloon_warp.scene import Scene
from balloon_warp.simulator import Simulator
from balloon_warp.system.files import (
    clear_left_over,
    hold,
    is_ours,
    manifest_text,
    target_of,
    temporary_in,
    whole_file,
    without_mark,
    write_npz,
)
from balloon_warp.system.process import Interrupts

if TYPE_CHECKING:
    from balloon_warp.usd import StageWriter
    from balloon_warp.usd.stage import GrowingStage


JOB_NAME = "job.json"
WAITING = 2
"""Number of frames that may wait to be written; more would only fill the memory"""


class PartialFolder:
    """A folder of files that each appear whole, in the order in which they are written, and their job.

    Args:
        path: where it is, or will be, or a link that leads there.
    """

    def __init__(self, path: Path):
        self.path = target_of(path)
        self.aside = self.path.with_name(f"{self.path.name}.old")
        """Place for the files of an earlier job when another begins, so that forgetting to resume loses nothing"""
        self._let_go: Callable[[], object] = lambda: None

    def job(self) -> dict[str, Any] | None:
        """Read the job of the files; None where there are none.

        Raises:
            InputError: there is something else.
        """
        path = self.path / JOB_NAME
        try:
            job = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: cannot be read: {error}") from None
        if not isinstance(job, dict):
            raise InputError(f"{path}: expected an object (got {type(job).__name__})")
        return without_mark(job)

    def require_own(self) -> None:
        """Make sure that an existing file or folder is ours to replace.

        Raises:
            InputError: it is something else of the same name.
        """
        for path in (self.path, self.aside):
            if path.exists() and not is_ours(path / JOB_NAME):
                begun = path.is_dir() and all(file.name.startswith(".") for file in path.iterdir())
                if not begun:
                    raise InputError(f"{path}: is where checkpoints go; expected no file of that name")

    def clear(self, has_checkpoint: bool) -> None:
        """Clear away the beginnings of a process that was killed: all of them, where it came to no checkpoint."""
        clear_left_over(self.path)
        if has_checkpoint:
            return
        with suppress(OSError):  # it has files, or there is no such folder
            self.path.rmdir()
        if self._take():
            self._let_go()
            _remove(self.path)

    def begin(self, job: Mapping[str, Any]) -> None:
        """Make the folder, for a job; the files of an earlier one are put aside.

        Raises:
            InputError: it cannot be made, or there is something else.
        """
        self.require_own()
        try:
            if self.path.exists():
                _remove(self.aside)
                self.path.rename(self.aside)
            self.path.mkdir()
        except OSError as error:
            raise InputError(f"{self.path}: cannot be made: {error.strerror}") from None
        with self.file(JOB_NAME) as path:
            path.write_text(manifest_text(job), encoding="utf-8")
        self._take()

    def go_on(self) -> None:
        """Go on with the job whose files are there."""
        self._take()

    def _take(self) -> bool:
        """Show other processes, as long as this one is at work here, that it is; return whether nobody else is."""
        try:
            descriptor = hold(self.path / JOB_NAME)
        except OSError:  # there is none
            return False
        if descriptor is None:
            return False
        self._let_go = weakref.finalize(self, os.close, descriptor)
        return True

    def file(self, name: str) -> AbstractContextManager[Path]:
        """Give a temporary path, which becomes the file of that name when the `with` block ends well."""
        return whole_file(self.path / name)

    def remove(self) -> None:
        """Remove the folder, and the files put aside, once the job is done."""
        self._let_go()
        for path in (self.path, self.aside):
            _remove(path)


def _remove(path: Path) -> None:
    """Remove a folder atomically: it is renamed first, so that a kill leaves no part of it that looks whole."""
    try:
        with temporary_in(path.parent) as doomed:
            path.rename(doomed)
    except FileNotFoundError:
        return
    except OSError as error:
        raise InputError(f"{path}: cannot be removed: {error.strerror}") from None


@dataclass(frozen=True)
class Part:
    """Part of a job."""

    frames: range
    groups: Sequence[int]
    """Numbers of the groups that are simulated one by one: of a run 0, of a batch its groups or its shares"""
    notes: Mapping[str, Any] = field(default_factory=dict)
    """Notes besides rows and shapes, as JSON"""


class Output(Protocol):
    """Output of a job, as far as checkpoints take parts of it."""

    @property
    def stage(self) -> "GrowingStage | None":
        """Stage that grows, if there is one."""

    def rows(self, part: Part) -> Mapping[str, NDArray]:
        """Return the contents of a part besides the stage, as arrays by name; files they refer to are safe then."""
        ...

    def take_rows(self, part: Part, saved: Mapping[str, NDArray]) -> None:
        """Put the arrays of a part that was saved in their places."""


def as_json(job: Mapping[str, Any]) -> dict[str, Any]:
    """Return a job as it is when it was written and read again."""
    return json.loads(json.dumps(job))


def differences(there: Any, here: Any, path: str = "") -> Iterator[str]:
    """Iterate over the differences of two jobs, each as a phrase."""
    if isinstance(there, dict) and isinstance(here, dict):
        for name in sorted(there.keys() | here.keys()):
            below = f"{path}.{name}" if path else name
            if name not in there or name not in here:
                yield f"{below} is {'here' if name in here else 'there'} only"
            else:
                yield from differences(there[name], here[name], below)
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        for number, pair in enumerate(zip(there, here, strict=True)):
            yield from differences(*pair, f"{path}.{number}")
    elif there != here:
        yield f"{path} is {_shown(there)} there and {_shown(here)} here"


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return f"a list of {len(value)}"
    text = json.dumps(value)
    return text if len(text) <= 80 else text[:77] + "..."


CHECKPOINT_SECONDS = 30.0
"""Time between two checkpoints [s]: the most that a kill costs"""
PLAYLIST, STILL = "frames.usda", "still.usdc"


@dataclass(frozen=True)
class CheckpointOptions:
    """Options of a job's checkpoints."""

    seconds: float = CHECKPOINT_SECONDS
    """Time between two [s]; 0 for none but the last of a job that is stopped"""
    resume: bool = False
    """Whether to go on from those that are there"""
    on_note: Callable[[str], None] = lambda sentence: None
    """Called with a sentence on the checkpoints that are there"""


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
    """

    def __init__(
        self,
        folder: Path,
        kind: str,
        job: Mapping[str, Any],
        scene: Scene,
        options: CheckpointOptions,
    ):
        self.seconds, self.resume, self.on_note = options.seconds, options.resume, options.on_note
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
        from balloon_warp.usd.stage import write_overlay, write_playlist  # loads USD: only for a stage

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


@dataclass(frozen=True)
class RunOutput:
    """Output of a run: a stage, and no rows."""

    stage: "StageWriter"

    def write(self, frame: Frame) -> None:
        """Write the next frame."""
        self.stage.write(frame)

    def rows(self, part: Part) -> Mapping[str, NDArray]:
        """Return nothing: all is in the stage."""
        return {}

    def take_rows(self, part: Part, saved: Mapping[str, NDArray]) -> None:
        """Take nothing."""


def partial_path(output: Path) -> Path:
    """Name the folder of a run that is not finished, beside its output, or beside the target of links there."""
    target = target_of(output)
    return target.with_name(f"{target.name}.partial")


def halvings_until(folder: Path, substeps: int) -> int:
    """Return how often an unfinished run had restarted with half the step.

    Args:
        folder: Folder of its checkpoints.
        substeps: Original number of substeps; where no halving fits it, it is another run, and 0 is returned.
    """
    reached = (PartialFolder(folder).job() or {}).get("substeps")
    halves = [substeps * 2**halvings for halvings in range(MOST_HALVINGS + 1)]
    return halves.index(reached) if reached in halves else 0


def describe_run(simulator: Simulator) -> dict[str, Any]:
    """Describe the inputs that decide a run's bits, for JSON. Before the run: mesh files may change meanwhile."""
    model = simulator.model
    done_by = {
        "strain_bound": strain_bound_described(model),
        "schedule": simulator.schedule.name,
        "device": model.device.name if model.device.is_cuda else "cpu",
    }
    return as_json(describe_simulation(model.scene, model.own_laws, model.substeps) | done_by)


Simulated = TypeVar("Simulated", contravariant=True)
State = Iterable[tuple[str, NDArray]]
"""Arrays by name"""


class FrameOutput(Output, Protocol[Simulated]):
    """Output that takes frames as they come."""

    def write(self, frame: Simulated, /) -> None:
        """Write the next frame."""


class Background:
    """Runner of jobs, one after the other, in a background thread.

    The `with` block ends when all are done.
    """

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="writer")
        self._jobs: deque[Future[None]] = deque()
        self._failed = False

    def __enter__(self) -> Self:
        return self

    def submit(self, job: Callable[..., None], *arguments: Any) -> None:
        """Queue a job; waits while `WAITING` are queued already."""
        if len(self._jobs) > WAITING:
            self._jobs.popleft().result()
        self._jobs.append(self._thread.submit(self._run, job, *arguments))

    def wait(self) -> None:
        """Wait until all queued jobs are done."""
        while self._jobs:
            self._jobs.popleft().result()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._thread.shutdown(wait=True)
        if error is None:
            self.wait()

    def _run(self, job: Callable[..., None], *arguments: Any) -> None:
        if not self._failed:
            try:
                job(*arguments)
            except BaseException:
                self._failed = True
                raise


def record_frames(
    frames: Iterable[tuple[int, Simulated]],
    output: FrameOutput[Simulated],
    checkpoints: Checkpoints,
    states: Sequence[Callable[[], State]],
    interrupts: Interrupts,
    on_frame: Callable[[int], None],
) -> None:
    """Write frames, on a thread of their own, and a checkpoint when one is due or the job is stopped.

    Args:
        frames: numbers and simulated frames for the output, as they come.
        states: Functions that return the state of each group after the last frame.
        interrupts: that stop the job, after a frame and its checkpoint.
        on_frame: Called with the number of each simulated frame.

    Raises:
        InputError: something cannot be written.
        KeyboardInterrupt: the job was stopped; the message says how to go on.
    """
    saved: int | None = None
    with Background() as writer:
        for number, frame in frames:
            saved = number if saved is None else saved
            writer.submit(output.write, frame)
            on_frame(number)
            if checkpoints.due or interrupts.pending:
                for group, state in enumerate(states):
                    checkpoints.save_state(number, group, state())
                writer.submit(checkpoints.save_part, output, Part(range(saved, number + 1), range(len(states))))
                saved = number + 1
            if interrupts.pending:
                writer.wait()
                interrupts.deliver(checkpoints.advice)

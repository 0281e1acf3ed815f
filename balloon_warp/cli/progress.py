"""A user's terminal: progress, estimates, warnings, and the wording of counts."""

import re
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich import console
from rich.console import ConsoleOptions, RenderableType
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)
from rich.segment import Segment
from rich.text import Text

from balloon_warp.errors import MissingExtraError, StoppedError
from balloon_warp.mesh.polygon_mesh import NO_AXIS
from balloon_warp.run.report import RunHeader
from balloon_warp.scene import Scene, bundled_scenes

if TYPE_CHECKING:
    from balloon_warp.lab.design.job import DesignStep


ACTING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
"""Control characters, but for tabs and ends of lines, and those that turn the direction of writing"""


def harmless(text: str) -> str:
    """Write characters that a terminal would act on as Python writes them, such as \\x1b."""
    return ACTING.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


class Console(console.Console):
    """Console of Rich that prints control characters, as of file names, as text."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=harmless(segment.text))


BLENDERS_RATE = 24.0
"""Frame rate at which Blender plays a stage by default, regardless of that of the stage [1/s]"""
OPTIONS = {name: f"--{name}" for name in (
    "cluster", "device", "every", "export", "font", "format", "gpus", "origin", "schedule", "seed", "table",
    "trajectories", "workers",
)} | {"on_blowup": "--on-blowup", "world_count": "--worlds"}  # fmt: skip
"""Options by the arguments of Python's functions that they are passed to"""


def with_options(sentence: str) -> str:
    """Write arguments as options of the command line, where a sentence begins with one and its value, or several."""
    at_fault, colon, rest = sentence.partition(":")
    named = [(*each.partition(" "),) for each in at_fault.split(", ")]
    if named[0][0] not in OPTIONS or not (named[0][1] or named[1:]):
        return sentence
    return ", ".join(OPTIONS.get(name, name) + space + value for name, space, value in named) + colon + rest


def counted(count: int, noun: str) -> str:
    """Return a count with its noun, such as `1 frame`, `2,000 frames` and `2 bodies`."""
    many = f"{noun.removesuffix('y')}ies" if noun.endswith("y") else f"{noun}s"
    return f"{count:,} {noun if count == 1 else many}"


def played(frames: int, rate: float, hint: bool = True) -> str:
    """Return the duration of a stage and its rate, and with `hint` a remedy where Blender plays it at another."""
    said = f"{frames / rate:.3g} s at {rate:g} frames/s"
    return (
        said
        if rate == BLENDERS_RATE or not hint
        else f"{said}; in Blender, set the frame rate to {rate:g}, or run with --fps {BLENDERS_RATE:g}"
    )


def begun(header: RunHeader) -> str:
    """Return all that tells one job from another in its log."""
    work = f"{counted(header.worlds, 'world')}, {briefly(header)}"
    device = f"{header.workers} x {header.device}" if header.workers > 1 else header.device
    frames = f"{counted(header.frames, 'frame')} at {header.frames_per_second:g} frames/s"
    return f"{work}, {frames}, on {device}, schedule {header.schedule}"


def briefly(header: RunHeader) -> str:
    """Return the cost of a frame: particles and substeps."""
    substeps = counted(header.substeps, "substep")
    return f"{counted(header.particles, 'particle')}, {substeps} a frame"


LEAST_FRAMES = 3
LEAST_SECONDS = 2.0
"""Least duration of the frames that an estimate is made from [s]"""
WORTH_TELLING = 60.0
"""Least remaining time that is reported [s]"""


def time_left(frames: int, seconds: float, left: int) -> str | None:
    """Return the remaining time, such as "about 12 min (600 frames at 0.8 frames/s)".

    None where it is too early to tell, or the run is soon done.

    Args:
        frames: Number of simulated frames.
        seconds: Time that they took [s].
        left: Number of frames to come.
    """
    if frames < LEAST_FRAMES or seconds < LEAST_SECONDS:
        return None
    rate = frames / seconds
    if left / rate < WORTH_TELLING:
        return None
    speed = f"{rate:.2g}" if rate < 100.0 else f"{rate:,.0f}"
    return f"about {_rounded(left / rate)} ({left:,} frames at {speed} frames/s)"


def _rounded(seconds: float) -> str:
    """Return a time rounded to whole minutes, hours and minutes, or days and hours."""
    minutes = round(seconds / 60.0)
    if minutes < 60:
        return f"{minutes} min"
    if minutes < 24 * 60:
        return f"{minutes // 60} h {minutes % 60} min"
    hours = round(minutes / 60.0)
    return f"{hours // 24:,} d {hours % 24} h"


@dataclass
class FirstEstimate:
    """Tells the time left, once. The first frame that comes does not count: in it kernels are compiled."""

    _told: bool = False
    _last: int | None = None
    """Frame that was simulated last"""
    _from: tuple[int, float] | None = None
    """Frame at which timing starts, and its time"""

    def after(self, frame: int, total: int, now: float) -> str | None:
        """Return the first sentence of `time_left`; None before and after.

        Args:
            frame: that was simulated.
            total: the last frame.
            now: by any clock [s].
        """
        if self._last is None or frame < self._last:  # it begins, or begins again
            self._from = None
        elif self._from is None and frame > self._last:
            self._from = frame, now
        self._last = frame
        if self._told or self._from is None:
            return None
        begun, since = self._from
        said = time_left(frame - begun, now - since, total - frame)
        self._told = said is not None
        return said

    def rate(self, now: float) -> float:
        """Return the frames a second since timing started; 0 before."""
        if self._from is None or self._last is None or now <= self._from[1]:
            return 0.0
        return (self._last - self._from[0]) / (now - self._from[1])


SPINNER_SECONDS = 0.5
"""Time after which a terminal shows a spinner [s]"""
LINE_SECONDS = 5.0
"""Duration from which on a stage gets a line in a log [s]"""


class Stages:
    """Shows the stage that is told to it.

    On a terminal it is beside a spinner, which vanishes in the end; elsewhere a long stage is a line, and a short one
    nothing.

    Args:
        name: of the file or scene in work.
        console: where that is shown.
    """

    def __init__(self, name: str, console: Console):
        self._name, self._console = name, console
        self._status = console.status("") if console.is_terminal else None
        self._lock = threading.Lock()
        self._waiting: threading.Timer | None = None
        self._stage = ""

    def __call__(self, stage: str) -> None:
        """Note that a stage begins."""
        with self._lock:
            self._stage = stage
            if self._status is None:
                self._wait(LINE_SECONDS)
            elif self._waiting is None:
                self._wait(SPINNER_SECONDS)
            else:
                self._status.update(escape(self._line))

    def end(self) -> None:
        """Show nothing any more."""
        with self._lock:
            self._stage = ""
            if self._waiting:
                self._waiting.cancel()
            if self._status:
                self._status.stop()

    def _wait(self, seconds: float) -> None:
        """Show the stage after some time, unless it is over then."""
        if self._waiting:
            self._waiting.cancel()
        self._waiting = threading.Timer(seconds, self._show, [self._stage])
        self._waiting.daemon = True
        self._waiting.start()

    def _show(self, stage: str) -> None:
        with self._lock:
            if self._status and self._stage:
                self._status.update(escape(self._line))
                self._status.start()
            elif stage and stage == self._stage:
                self._console.print(self._line, markup=False, highlight=False, soft_wrap=True)

    @property
    def _line(self) -> str:
        return f"{self._name}: {self._stage}"


@contextmanager
def stages(name: str) -> Iterator[Stages]:
    """Show on standard error the stages that are told to it in the `with` block."""
    shown = Stages(name, Console(emoji=False, stderr=True))
    try:
        yield shown
    finally:
        shown.end()


def warn(sentence: str) -> None:
    """Print a warning on standard error, where no program reads results."""
    Console(emoji=False, stderr=True, highlight=False, soft_wrap=True).print(f"[yellow]warning:[/] {escape(sentence)}")


def note(sentence: str) -> None:
    """Print a note on standard error, where no program reads results."""
    Console(emoji=False, stderr=True, highlight=False, soft_wrap=True).print(f"[cyan]note:[/] {escape(sentence)}")


class Opening:
    """First line of a run about its mesh, printed before any other; a run that does not begin prints its error alone.

    Args:
        name: of the simulated scene.
        sentence: a note on it, if there is one.
    """

    def __init__(self, name: str, sentence: str | None):
        self._name, self._sentence, self._more = name, sentence, ""
        self._then: str | None = None

    def add(self, *more: str | None, then: str | None = None) -> None:
        """Take further sentences of the line, and a note below it."""
        self._more, self._then = ". ".join(filter(None, more)), then

    def before(self, listener: Callable[..., Any]) -> Callable[..., None]:
        """Return a listener that says the line, if nobody did, before it hears anything."""

        def listen(*words: Any) -> None:
            self._say()
            listener(*words)

        return listen

    def _say(self) -> None:
        sentence, more, then = self._sentence, self._more, self._then
        self._sentence, self._more, self._then = None, "", None
        if sentence:
            note(f"{sentence}. {more}" if more else sentence)
        elif more:
            Console(emoji=False, stderr=True, highlight=False, soft_wrap=True).print(
                f"{self._name}: {more}", markup=False
            )
        if then:
            note(then)


def unsaid(first: str | None, sentences: Iterable[str]) -> list[str]:
    """Return the warnings without those on the up axis, which the first line about a mesh by itself has named."""
    if first is None or NO_AXIS not in first:
        return [*sentences]
    return [each for each in sentences if NO_AXIS not in each or not first.startswith(each.partition(":")[0])]


def warner(first: str | None) -> Callable[[str], None]:
    """Return a listener that prints the warnings that the first line has not named."""

    def listen(sentence: str) -> None:
        for each in unsaid(first, [sentence]):
            warn(each)

    return listen


def first_line(source: str, scene: Scene) -> str | None:
    """Return the first line about a mesh by itself: its default scene."""
    return None if source in bundled_scenes() or Path(source).suffix.lower() == ".toml" else scene.description


@contextmanager
def watched(view: bool, port: int | None, name: str) -> "Iterator[Callable[[DesignStep], None]]":
    """Draw the steps that it gets into a page, which stays after the block until Ctrl-C; or do nothing with them.

    Args:
        view: whether it is wanted.
        port: of the page; 8080 or the next free one, when missing.
        name: of the design.

    Raises:
        InputError: the page cannot be served.
        MissingExtraError: viser is not installed.
    """
    if not view:
        yield lambda step: None
        return
    try:
        from balloon_warp.lab.design.page import DesignPage
    except ModuleNotFoundError as missing:
        if missing.name != "viser":
            raise
        raise MissingExtraError("--view needs viser: pip install 'balloon-warp[view]'") from None
    page, console = DesignPage(port=port, on_refused=warn), Console(emoji=False, highlight=False, soft_wrap=True)
    try:
        console.print(f"{escape(name)} is at {page.address}")
        yield page.show
        console.print("Ctrl-C closes the page")
        with suppress(KeyboardInterrupt):
            stay()
    finally:
        page.stop()


def stay() -> None:
    """Wait for Ctrl-C."""
    threading.Event().wait()


LOG_SECONDS = 30.0
"""Interval between lines of a log [s]"""
WIDE = 110
"""Width of a terminal with room for more than the bar [columns]"""


class _FrameRate(ProgressColumn):
    """Frames a second, once there are any."""

    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:.0f} frames/s" if task.speed else "")


class _About(ProgressColumn):
    """Column with the cost of a frame, once it is known."""

    def render(self, task: Task) -> Text:
        return Text(task.fields.get("about", ""), style="dim")


class FrameProgress(Progress):
    """A bar with frames a second and the time left.

    Where the console is no terminal, it is a log line every `LOG_SECONDS`. Both report the duration of a long run
    early.
    """

    def __init__(self, console: Console):
        self._logs, self._said = not console.is_terminal, time.monotonic()
        self._estimate = FirstEstimate()
        columns = (TextColumn("{task.description}"), _About(), BarColumn(), MofNCompleteColumn(), _FrameRate())
        super().__init__(*columns, TimeRemainingColumn(), console=console, disable=self._logs, transient=True)

    def begin(self, task_id: TaskID, header: RunHeader) -> str | None:
        """Show the cost of a frame beside the bar, if there is room; return the line of a log where there is no bar."""
        if self._logs:
            return begun(header)
        if self.console.width >= WIDE:
            super().update(task_id, about=briefly(header))
        return None

    def log_line(self, line: str) -> None:
        """Print a line, if there is no bar."""
        if self._logs:
            self._print(line)

    def update(self, task_id: TaskID, **fields: Any) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Update the progress of a task."""
        super().update(task_id, **fields)
        task = self._tasks[task_id]
        if task.total and (left := self._estimate.after(int(task.completed), int(task.total), self.get_time())):
            self._print(f"{task.description}: {left}")
        if self._logs and time.monotonic() - self._said >= LOG_SECONDS:
            self._said = time.monotonic()
            self._print(self._line(task))

    def _print(self, line: str) -> None:
        self.console.print(line, markup=False, highlight=False, soft_wrap=True)

    def _line(self, task: Task) -> str:
        """Return a line such as "squirrel: frame 120 of 600, 4.1 frames/s, 117 s left"."""
        total = f" of {task.total:,.0f}" if task.total else ""
        rate = self._estimate.rate(self.get_time())
        speed = f", {rate:.3g} frames/s" if rate else ""
        left = f", {(task.total - task.completed) / rate:,.0f} s left" if rate and task.total else ""
        return f"{task.description}: frame {task.completed:,.0f}{total}{speed}{left}"


@contextmanager
def frame_progress() -> Iterator[FrameProgress]:
    """Show the progress of tasks.

    Raises:
        StoppedError: the `with` block was interrupted; the message says how far it was.
    """
    with FrameProgress(Console(emoji=False, stderr=True)) as progress:
        try:
            yield progress
        except KeyboardInterrupt as stop:
            task = progress.tasks[-1]
            far = f"after frame {task.completed:.0f} of {task.total:.0f}" if task.total else "before the first frame"
            raise StoppedError(
                f"{task.description} was interrupted {far}; {str(stop) or 'nothing was written'}"
            ) from None

"""Progress of a run: a bar on a terminal, a line now and then in a log."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

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
from rich.text import Text

from balloon_warp.beginning import Beginning
from balloon_warp.cli.console import Console
from balloon_warp.cli.estimate import FirstEstimate
from balloon_warp.cli.words import begun, briefly
from balloon_warp.errors import StoppedError

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

    def begin(self, task_id: TaskID, beginning: Beginning) -> str | None:
        """Show the cost of a frame beside the bar, if there is room; return the line of a log where there is no bar."""
        if self._logs:
            return begun(beginning)
        if self.console.width >= WIDE:
            super().update(task_id, about=briefly(beginning))
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

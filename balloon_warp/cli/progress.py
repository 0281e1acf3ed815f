"""How far a run is."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

from balloon_warp.errors import StoppedError


class _FrameRate(ProgressColumn):
    """Frames a second, once there are any."""

    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:.0f} frames/s" if task.speed else "")


@contextmanager
def frame_progress() -> Iterator[Progress]:
    """A bar with frames a second and the time left, on a terminal; nothing in a pipe.

    Raises:
        StoppedError: what is in the `with` block was stopped, and how far it was.
    """
    console = Console(stderr=True)
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        _FrameRate(),
        TimeRemainingColumn(),
        console=console,
        disable=not console.is_terminal,
        transient=True,
    ) as progress:
        try:
            yield progress
        except KeyboardInterrupt as stop:
            task = progress.tasks[-1]
            far = f"after frame {task.completed:.0f} of {task.total:.0f}" if task.total else "before its first frame"
            raise StoppedError(f"{task.description} was stopped {far}; {str(stop) or 'nothing was written'}") from None

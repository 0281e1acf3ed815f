"""Stages of a long command without frames to count."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from rich.markup import escape

from balloon_warp.cli.console import Console

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

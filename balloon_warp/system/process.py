"""Standard streams that are closed or full, and signals that are deferred."""

import os
import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any, Self, TextIO


def open_closed_streams() -> None:
    """Open /dev/null in place of each standard stream that is closed.

    The next file that is opened would otherwise be the stream, and get the output that libraries print there.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # it gets the lowest number that is free


def watch_streams() -> None:
    """Make standard output tell when it cannot be written, and standard error lose it."""
    open_closed_streams()
    if sys.stdout is not None:
        sys.stdout = _Watched(sys.stdout, _tell)
    if sys.stderr is not None:
        sys.stderr = _Watched(sys.stderr, lambda error: None)


def lose_output() -> None:
    """Write nothing to standard output any more, where the buffered output cannot be written either."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)


class OutputLostError(OSError):
    """Standard output cannot be written."""


def _tell(error: OSError) -> None:
    raise OutputLostError(error.errno, error.strerror) from None


class _Watched:
    """A stream.

    Args:
        stream: the watched one.
        on_error: called with why a text cannot be written.
    """

    def __init__(self, stream: TextIO, on_error: Callable[[OSError], None]):
        self._stream, self._on_error = stream, on_error

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write a text, as far as that is possible."""
        try:
            return self._stream.write(text)
        except OSError as error:
            self._on_error(error)
            return len(text)

    def flush(self) -> None:
        """Write the buffered text, as far as that is possible."""
        try:
            self._stream.flush()
        except OSError as error:
            self._on_error(error)


class Interrupts:
    """Notes the signals that come while its `with` block runs, for the block to act on when it can.

    A second signal is not held back. Outside the main thread, which alone gets signals, it notes none; nor does it a
    signal that no Python function handles.
    """

    def __init__(self) -> None:
        self._handlers: dict[int, Any] = {}
        self._come: tuple[int, FrameType | None] | None = None

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                if callable(handler := signal.getsignal(number)):
                    self._handlers[number] = handler
                    signal.signal(number, self._note)
        return self

    @property
    def pending(self) -> bool:
        """Return whether a signal has come."""
        return self._come is not None

    def deliver(self, message: str = "") -> None:
        """Deliver a signal that has come, as its own handler would.

        Raises:
            KeyboardInterrupt: with that message, where the signal's own handler raises it.
        """
        if self._come:
            number, frame = self._come
            self._come = None
            try:
                self._handlers[number](number, frame)
            except KeyboardInterrupt:
                raise KeyboardInterrupt(message) from None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        if kind is None:
            self.deliver("")

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self._come:
            self._come = None
            self._handlers[number](number, frame)
        else:
            self._come = number, frame

"""Standard streams that are closed, full, or of an end that nobody reads."""

import os
import sys
from collections.abc import Callable
from typing import Any, TextIO


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

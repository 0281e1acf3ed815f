"""The process: Python's collector, lent functions and forked children; standard streams and deferred signals.

A forked child has none of its parent's threads: whoever waits for one, or for its lock, hangs. So a process forks while
no other thread holds a lock of the program, and pools of threads start anew in the child.
"""

import gc
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any, ParamSpec, Self, TextIO, TypeVar


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Suspend the cyclic garbage collector while long-lived objects are loaded or made.

    That takes a sixth of the time until the first frame. Afterwards, if a search is due, all of it counts as old, and
    is looked through seldom.

    Nothing changes where whoever calls has turned the search off.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            is_due = gc.get_count()[0] > gc.get_threshold()[0]
            if is_due and not gc.get_freeze_count():  # which counts them: else, objects that others froze would thaw
                gc.freeze()
                gc.unfreeze()  # into the oldest generation, wherever it was
            gc.enable()


LENT: dict[str, Callable[..., Any]] = {}
"""Pictures of a frame, `snapshot` and `notebook_picture`, and `stiffness_in`, a balloon's stiffness operator"""
P = ParamSpec("P")
T = TypeVar("T")


class Threads:
    """Pool of threads, as `ThreadPoolExecutor`, that works in forked children, too.

    Args:
        count: of threads at most.
        name: that of threads begins so.
    """

    def __init__(self, count: int, name: str = ""):
        self._given = count, name
        self._begin()

    def submit(self, call: Callable[P, T], *arguments: P.args, **named: P.kwargs) -> Future[T]:
        """Begin a call in a thread."""
        if self._process != os.getpid():
            self._begin()
        return self._pool.submit(call, *arguments, **named)

    def map(self, call: Callable[[Any], T], items: Any) -> Iterator[T]:
        """Yield the results of calls, in the order of the items."""
        begun = [self.submit(call, item) for item in items]
        return (each.result() for each in begun)

    def _begin(self) -> None:
        self._pool, self._process = ThreadPoolExecutor(*self._given), os.getpid()


def hold_in_forks(take: Callable[[], Any], release: Callable[[], Any]) -> None:
    """Have each fork wait for a lock, and hold it until both processes have gone on.

    Locks are taken in the opposite order of these calls.
    """
    if hasattr(os, "register_at_fork"):  # Windows has no forks
        os.register_at_fork(before=take, after_in_parent=release, after_in_child=release)


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

"""Loading of the package: Python's collector put off, functions that rooms lend to the core, and forked children.

Threads and locks in a forked child, which has none of its parent's threads: whoever waits for one hangs.

So a process forks while no other thread holds a lock of the program, and pools of threads start anew in the child.
"""

import gc
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, ParamSpec, TypeVar


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

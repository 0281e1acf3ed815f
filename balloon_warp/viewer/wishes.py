"""Wishes from other threads, queued until the simulation's thread grants them between two frames.

A touch whose kernels are still being compiled waits for them; time and the other wishes do not wait for it.
"""

import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass

from balloon_warp.errors import InputError
from balloon_warp.viewer.playground import Playground
from balloon_warp.viewer.touches import Kinds, Touch

MOST_ASKED = 1000
"""Largest number of waiting wishes; more are ignored"""
GRANTING_SECONDS = 0.1
"""Time that wishes may take before a frame is simulated again [s]"""

Wish = Callable[[Playground], None]


@dataclass(frozen=True)
class _Waiting:
    """A wish that waits."""

    wish: Wish
    touch: Touch | None
    number: int
    """Number of wishes until it, and with it"""
    since: float


class Wishes:
    """First come, first served.

    Args:
        refused: called with a sentence, where a wish cannot be granted.
    """

    def __init__(self, refused: Callable[[str], None]):
        self.came = threading.Event()
        """Event that is set when there are wishes"""
        self.asked, self.granted = 0, 0
        """Number of wishes so far, and number of those granted"""
        self._refused = refused
        self._waiting: dict[object, _Waiting] = {}
        self._lock = threading.Lock()
        self._failures: set[type[Exception]] = set()
        """Failures that the terminal was told about"""

    def add(self, wish: Wish, key: object = None, touch: Touch | None = None) -> None:
        """Add a wish; of several waiting with the same key, only the last is granted. From any thread.

        Args:
            touch: what it does to the scene; nothing that needs other kernels, when missing.
        """
        with self._lock:
            if len(self._waiting) < MOST_ASKED:
                key = key if key is not None else object()
                self._waiting.pop(key, None)
                self.asked += 1
                self._waiting[key] = _Waiting(wish, touch, self.asked, time.perf_counter())
        self.came.set()

    def drop_touches(self) -> None:
        """Forget what still waits for kernels: the scene is another one."""
        with self._lock:
            self._waiting = {key: each for key, each in self._waiting.items() if each.touch is None}

    @property
    def waited_seconds(self) -> float:
        """Time for which the oldest wish waits [s]; 0 without one."""
        with self._lock:
            since = [each.since for each in self._waiting.values()]
        return time.perf_counter() - min(since) if since else 0.0

    def grant(self, playground: Callable[[], Playground], is_ready: Callable[[Kinds], bool]) -> bool:
        """Grant the waiting wishes; where there are many, the rest waits for the next frame.

        Args:
            playground: Current playground; a wish may bring another.
            is_ready: whether there are kernels for such things.

        Returns:
            Whether anything was asked for.
        """
        until, any_came = time.perf_counter() + GRANTING_SECONDS, False
        while wish := self._next(playground(), is_ready):
            any_came = True
            self._grant(wish, playground())
            if time.perf_counter() > until:
                self.came.set()
                break
        return any_came

    def _next(self, playground: Playground, is_ready: Callable[[Kinds], bool]) -> Wish | None:
        waits = set()
        """Lines in which somebody waits"""
        with self._lock:
            for key, each in self._waiting.items():
                if each.touch and (each.touch.line in waits or not is_ready(each.touch.leaves(playground.live))):
                    waits.add(each.touch.line)
                    continue
                return self._waiting.pop(key).wish
            self.granted = min((each.number for each in self._waiting.values()), default=self.asked + 1) - 1
            return None

    def _grant(self, wish: Wish, playground: Playground) -> None:
        try:
            wish(playground)
        except (InputError, ValueError, TypeError, IndexError, OverflowError) as mistake:
            self._refused(str(mistake).partition("\n")[0])
        except Exception as mistake:  # one of ours must not end the page that others watch
            self.fail(mistake)
            self._refused("this failed; the terminal has the error")

    def fail(self, mistake: Exception) -> None:
        """Report an unexpected failure on the terminal; once of each kind, so that it does not fill it."""
        if type(mistake) not in self._failures:
            self._failures.add(type(mistake))
            traceback.print_exception(mistake)

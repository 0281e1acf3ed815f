"""Wishes from other threads, queued until the simulation's thread grants them between two frames."""

import threading
import time
import traceback
from collections.abc import Callable

from balloon_warp.errors import InputError
from balloon_warp.viewer.playground import Playground

MOST_ASKED = 1000
"""Largest number of waiting wishes; more are ignored"""
GRANTING_SECONDS = 0.1
"""Time that wishes may take before a frame is simulated again [s]"""

Wish = Callable[[Playground], None]


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
        self._waiting: dict[object, Wish] = {}
        self._lock = threading.Lock()
        self._failures: set[type[Exception]] = set()
        """Failures that the terminal was told about"""

    def add(self, wish: Wish, key: object = None) -> None:
        """Add a wish; of several waiting with the same key, only the last is granted. From any thread."""
        with self._lock:
            if len(self._waiting) < MOST_ASKED:
                key = key if key is not None else object()
                self._waiting.pop(key, None)
                self._waiting[key] = wish
                self.asked += 1
        self.came.set()

    def grant(self, playground: Callable[[], Playground]) -> bool:
        """Grant the waiting wishes; where there are many, the rest waits for the next frame.

        Args:
            playground: Current playground; a wish may bring another.

        Returns:
            Whether anything was asked for.
        """
        until, any_came = time.perf_counter() + GRANTING_SECONDS, False
        while wish := self._next():
            any_came = True
            self._grant(wish, playground())
            if time.perf_counter() > until:
                self.came.set()
                break
        return any_came

    def _next(self) -> Wish | None:
        with self._lock:
            if self._waiting:
                return self._waiting.pop(next(iter(self._waiting)))
            self.granted = self.asked
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

"""Minima of a function from many starts, each its own way; all are asked together, as worlds of one batch."""

from collections.abc import Callable
from threading import Condition, Thread
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

Values = NDArray[np.float64]
Ask = Callable[[Values], tuple[Values, Values]]
"""Function from places, shape (n, p), to numbers, shape (n,), and their derivatives, shape (n, p)"""
STEEP = 1.0e3
"""Stand-in for a number that is not finite, over that of the start: a step there is taken back"""


class _Meeting:
    """Barrier at which starts hand in places and get the values there, all from one batch."""

    def __init__(self, places: Values):
        self.places = places.copy()
        self._asking: set[int] = set()
        self._going = set(range(len(places)))
        self._changed = Condition()
        self._found: tuple[Values, Values] = np.empty(0), np.empty((0, 0))

    def ask(self, start: int, place: Values) -> tuple[float, Values]:
        """Hand in a place, and return its value and derivatives once all have."""
        with self._changed:
            self.places[start] = place
            self._asking.add(start)
            self._changed.notify_all()
            self._changed.wait_for(lambda: start not in self._asking)
            return float(self._found[0][start]), self._found[1][start]

    def leave(self, start: int) -> None:
        """Withdraw a start."""
        with self._changed:
            self._going.discard(start)
            self._changed.notify_all()

    def serve(self, ask: Ask) -> bool:
        """Wait for all, and answer them; return False once all have left."""
        with self._changed:
            self._changed.wait_for(lambda: self._asking == self._going)
            if not self._going:
                return False
        try:
            found = ask(self.places)
        except BaseException:
            self.close()
            raise
        with self._changed:
            self._found = found
            self._asking.clear()
            self._changed.notify_all()
        return True

    def close(self) -> None:
        """Answer all with zeros, on which a descent ends."""
        with self._changed:
            count, width = self.places.shape
            self._found = np.zeros(count), np.zeros((count, width))
            self._asking.clear()
            self._changed.notify_all()


def minima_together(ask: Ask, first: Values, rounds: int, on_round: Callable[[int, float], None]) -> tuple[Values, int]:
    """Return the places of the minima between 0 and 1, shape (n, p), by L-BFGS-B, and how often was asked.

    Args:
        first: where starts begin; those whose number is not finite stay there.
        on_round: told the number of the answer, and the least number so far.
    """
    values, slopes = ask(first)
    scales = np.where(np.isfinite(values) & (values != 0.0), np.abs(values), 1.0)
    meeting, places = _Meeting(first), first.copy()
    known = {start: (first[start], values[start], slopes[start]) for start in range(len(first))}

    def descend(start: int) -> None:
        def told(place: Values) -> tuple[float, Values]:
            begin, value, slope = known[start]
            if not (place == begin).all():
                value, slope = meeting.ask(start, place)
            if not np.isfinite(value):
                return STEEP, np.zeros_like(place)
            return value / scales[start], slope / scales[start]

        try:
            bounds = [(0.0, 1.0)] * first.shape[1]
            options: Any = {"maxiter": rounds, "maxfun": 3 * rounds, "ftol": 1e-9}
            places[start] = minimize(told, first[start], jac=True, method="L-BFGS-B", bounds=bounds, options=options).x
        finally:
            meeting.leave(start)

    threads = [Thread(target=descend, args=(start,), daemon=True) for start in np.flatnonzero(np.isfinite(values))]
    for start in np.flatnonzero(~np.isfinite(values)):
        meeting.leave(int(start))
    for thread in threads:
        thread.start()
    asked, least = 1, float(np.nanmin(np.where(np.isfinite(values), values, np.inf)))

    def counted(asking: Values) -> tuple[Values, Values]:
        nonlocal asked, least
        found = ask(asking)
        asked += 1
        least = min(least, float(np.min(np.where(np.isfinite(found[0]), found[0], np.inf))))
        on_round(asked, least)
        return found

    while meeting.serve(counted):
        pass
    for thread in threads:
        thread.join()
    return places, asked

"""Beginnings of frames, kept for the way back: of all, or of so few that others are computed again from them.

Few are kept by the binomial schedule (Griewank and Walther, "Algorithm 799: Revolve", 2000): no other computes fewer
frames again. With c of them and frames computed again at most r times, binomial(c + r, c) frames can run back.
"""

from collections.abc import Callable
from math import comb
from typing import Any, Protocol


class Beginnings(Protocol):
    """Beginnings of frames, noted in their order and taken from the last to the first."""

    def note(self, frame: int) -> None:
        """Note the start state of a frame that is about to be simulated."""

    def take(self, frame: int) -> Any:
        """Return the start state of a frame, once."""


class AllFrames:
    """Keep the start state of every frame.

    Args:
        keep: returns a copy of the current state, with which a frame begins.
    """

    def __init__(self, keep: Callable[[int], Any]):
        self._keep = keep
        self._kept: list[Any] = []

    def note(self, frame: int) -> None:
        """Keep the state with which a frame begins."""
        self._kept.append(self._keep(frame))

    def take(self, frame: int) -> Any:
        """Return the start state of the last frame that has not been taken."""
        return self._kept.pop()


class FewFrames:
    """Keep the start states of few frames, and simulate others again from there.

    Args:
        frames: number of all frames.
        most: of those that are kept at a time, at least 1.
        keep: returns a copy of the current state, with which a frame begins.
        go_back: takes such a copy, so that its frame is about to be simulated again.
        advance: simulates a frame again.
    """

    def __init__(
        self, frames: int, most: int, keep: Callable[[int], Any], go_back: Callable[[int, Any], None],
        advance: Callable[[int], None],
    ):  # fmt: skip
        self._most, self._keep, self._go_back, self._advance = most, keep, go_back, advance
        self._kept: list[tuple[int, Any]] = []
        self._first = [0]
        while len(self._first) < most and frames - self._first[-1] > 1:
            self._first.append(self._first[-1] + way_to_next(frames - self._first[-1], most - len(self._first)))

    def note(self, frame: int) -> None:
        """Keep the start state of a frame, if it is one of those that are worth it."""
        if len(self._kept) < len(self._first) and self._first[len(self._kept)] == frame:
            self._kept.append((frame, self._keep(frame)))

    def take(self, frame: int) -> Any:
        """Return the start state of the last frame that has not been taken."""
        if self._kept[-1][0] == frame:
            return self._kept.pop()[1]
        now = self._kept[-1][0]
        self._go_back(*self._kept[-1])
        while now < frame:
            free = self._most - len(self._kept)
            until = now + way_to_next(frame + 1 - now, free) if free else frame
            for number in range(now, until):
                self._advance(number)
            now = until
            if free and now < frame:
                self._kept.append((now, self._keep(now)))
        return self._keep(frame)


def frames_again(frames: int, free: int) -> int:
    """Return how many frames are simulated at least so that all run back, where each is computed again in doing so.

    The first simulation of frames counts, up to the last frame that is kept.

    Args:
        free: number of beginnings that may be kept beside that of the first frame.
    """
    most = free + 1
    times = 0
    while comb(most + times, most) < frames:
        times += 1
    return times * frames - comb(most + times, most + 1)


def way_to_next(frames: int, free: int) -> int:
    """Return after how many of some frames, of which the first is kept, the next one is to be kept.

    Args:
        free: number of beginnings that may be kept beside the first one, at least 1.
    """

    def cost(way: int) -> int:  # convex
        return way + frames_again(frames - way, free - 1) + frames_again(way, free)

    low, high = 1, frames - 1
    while low < high:
        middle = (low + high) // 2
        if cost(middle + 1) < cost(middle):
            low = middle + 1
        else:
            high = middle
    return low

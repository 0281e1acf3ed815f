"""The moments of a simulation that is played with that one can go back to."""

from collections import deque

from balloon_warp.viewer.moment import Moment
from balloon_warp.viewer.playground import Playground

APART_SECONDS = 0.5
"""Simulated time between two kept moments [s]"""
MOST = 12
SWOLLEN = 3.0
"""Size over that at the first moment, above which a shape is not worth returning to"""


class Moments:
    """Last moments of a simulation, oldest first."""

    def __init__(self) -> None:
        self._kept: deque[Moment] = deque(maxlen=MOST)

    def clear(self) -> None:
        """Drop all kept moments."""
        self._kept.clear()

    def note(self, playground: Playground) -> None:
        """Keep the current moment, if enough time has passed since the last."""
        if not self._kept or playground.frame - self._kept[-1].frame >= _frames_apart(playground):
            self._kept.append(playground.moment())

    def go_back(self, playground: Playground) -> bool:
        """Go back to the last good moment, and the next time to the one before; return whether there was one.

        It is at least half of the time between two ago, and before it swelled past recognition.
        """
        kept, apart = self._kept, _frames_apart(playground)
        while len(kept) > 1 and (
            playground.frame - kept[-1].frame < apart / 2 or kept[-1].extent > SWOLLEN * kept[0].extent
        ):
            kept.pop()
        if not kept:
            return False
        playground.return_to(kept.pop())
        return True


def _frames_apart(playground: Playground) -> float:
    return APART_SECONDS / playground.simulator.model.frame_seconds

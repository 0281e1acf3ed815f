"""Pace of the page: simulated time against real time."""

from collections import deque

MOST_BEHIND = 0.25
"""Largest lag of the simulation that it can catch up [s]; beyond it, time runs slower instead"""
WINDOW = 1.0
"""Window over which the rate is averaged [s]"""


class Pace:
    """Pace of simulated time: when each frame is due, and how fast time really runs.

    Args:
        speed: Simulated seconds a second of the wall's clock.
    """

    def __init__(self, speed: float = 1.0):
        self.speed = speed
        self._due: float | None = None
        self._passed: deque[tuple[float, float]] = deque()
        """Times at which frames were done, and simulated time of each [s]"""

    def rest(self) -> None:
        """Stop time until the next frame."""
        self._due = None
        self._passed.clear()

    def wait(self, now: float, frame_seconds: float) -> float:
        """Return the seconds until the next frame is due; counts on it being simulated then."""
        if self._due is None or now > self._due + MOST_BEHIND:
            self._due = now
        wait = max(self._due - now, 0.0)
        self._due += frame_seconds / self.speed
        return wait

    def passed(self, now: float, frame_seconds: float) -> None:
        """Record that a frame is done."""
        self._passed.append((now, frame_seconds))
        while now - self._passed[0][0] > WINDOW:
            self._passed.popleft()

    @property
    def rate(self) -> float:
        """Simulated seconds over the wall's, lately; 0 until there are two frames."""
        if len(self._passed) < 2:
            return 0.0
        simulated = sum(seconds for _, seconds in list(self._passed)[1:])
        return simulated / max(self._passed[-1][0] - self._passed[0][0], 1e-9)

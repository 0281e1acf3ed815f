"""Estimate of a run's remaining time, reported once its first frames are simulated."""

from dataclasses import dataclass

LEAST_FRAMES = 3
LEAST_SECONDS = 2.0
"""Least duration of the frames that an estimate is made from [s]"""
WORTH_TELLING = 60.0
"""Least remaining time that is reported [s]"""


def time_left(frames: int, seconds: float, left: int) -> str | None:
    """Return the remaining time, such as "about 12 min (600 frames at 0.8 frames/s)".

    None where it is too early to tell, or the run is soon done.

    Args:
        frames: Number of simulated frames.
        seconds: Time that they took [s].
        left: Number of frames to come.
    """
    if frames < LEAST_FRAMES or seconds < LEAST_SECONDS:
        return None
    rate = frames / seconds
    if left / rate < WORTH_TELLING:
        return None
    speed = f"{rate:.2g}" if rate < 100.0 else f"{rate:,.0f}"
    return f"about {_rounded(left / rate)} ({left:,} frames at {speed} frames/s)"


def _rounded(seconds: float) -> str:
    """Return a time rounded to whole minutes, hours and minutes, or days and hours."""
    minutes = round(seconds / 60.0)
    if minutes < 60:
        return f"{minutes} min"
    if minutes < 24 * 60:
        return f"{minutes // 60} h {minutes % 60} min"
    hours = round(minutes / 60.0)
    return f"{hours // 24:,} d {hours % 24} h"


@dataclass
class FirstEstimate:
    """Tells the time left, once. The first frame that comes does not count: in it kernels are compiled."""

    _told: bool = False
    _last: int | None = None
    """Frame that was simulated last"""
    _from: tuple[int, float] | None = None
    """Frame at which timing starts, and its time"""

    def after(self, frame: int, total: int, now: float) -> str | None:
        """Return the first sentence of `time_left`; None before and after.

        Args:
            frame: that was simulated.
            total: the last frame.
            now: by any clock [s].
        """
        if self._last is None or frame < self._last:  # it begins, or begins again
            self._from = None
        elif self._from is None and frame > self._last:
            self._from = frame, now
        self._last = frame
        if self._told or self._from is None:
            return None
        begun, since = self._from
        said = time_left(frame - begun, now - since, total - frame)
        self._told = said is not None
        return said

    def rate(self, now: float) -> float:
        """Return the frames a second since timing started; 0 before."""
        if self._from is None or self._last is None or now <= self._from[1]:
            return 0.0
        return (self._last - self._from[0]) / (now - self._from[1])

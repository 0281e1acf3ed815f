"""Schedules assign the work of a substep to threads; the physics is the same in each."""

from balloon_warp.schedules.choose import SCHEDULES, Schedule, make_schedule

__all__ = ["SCHEDULES", "Schedule", "make_schedule"]

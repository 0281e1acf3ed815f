"""Schedules decide which thread computes what; the physics is the same in each."""

from balloon_warp.schedules.scatter import ScatterSchedule

__all__ = ["ScatterSchedule"]

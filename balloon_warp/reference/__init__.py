"""Reference of the step: laws, gas, contact and one substep in NumPy and float64, the arbiter of all schedules."""

from balloon_warp.reference.step import Reference

__all__ = ["Reference"]

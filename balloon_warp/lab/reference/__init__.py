"""Reference of the step: laws, gas, contact and one substep in NumPy and float64, the arbiter of all schedules.

Read `step` first, which has what is taken from the plan and the order of a substep; `laws` has the formulas, of gas,
too; `contact` its one rule, the kinds and its springs; `solids` obstacles and free bodies.
"""

from balloon_warp.lab.reference.step import Reference

__all__ = ["Reference"]

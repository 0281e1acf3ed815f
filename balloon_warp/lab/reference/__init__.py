"""Reference of the step: laws, gas, contact and one substep in NumPy and float64, the arbiter of all schedules.

Read `step` first, which has the order of a substep; `laws` and `gas` have the formulas, `contact` its one rule and the
kinds, `touch` its springs, `solids` and `bodies` what stands around, and `tables` what is taken from the plan.
"""

from balloon_warp.lab.reference.step import Reference

__all__ = ["Reference"]

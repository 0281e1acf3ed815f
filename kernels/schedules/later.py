"""Particles that may meet an obstacle are put off: they leave it in a launch of their own, one beside the other. A warp
in which one of them moves among others that meet nothing would go its way with it.

Two lists take turns, substep by substep: who reads one empties the other.
"""

import warp as wp

from balloon_warp.kernels.schedules.warps import next_place
from balloon_warp.kernels.tables import Tables


@wp.func
def turn_of(t: Tables, time_in_frame: float):
    """0 or 1, by the substep that begins at a time."""
    return wp.int32(time_in_frame / t.step_seconds + 0.5) & 1


@wp.func
def put_off(
    lists: wp.array2d[wp.int32], counts: wp.array2d[wp.int32], world: wp.int32, particle: wp.int32, turn: wp.int32
):
    """By any thread in any order."""
    lists[world, next_place(counts, world, turn)] = particle

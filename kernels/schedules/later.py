"""Particles that contacts push, or that may meet an obstacle, are put off: they end their substep when all have moved,
one beside the other. A warp in which one of them moves among others that meet nothing would go its way with it.

It moves only then, by its whole velocity: float32 rounds a way there and back again, and what stands under load would
tremble. Two lists take turns, substep by substep: who reads one empties the other.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.loops.fixture_looks import is_free
from balloon_warp.kernels.loops.obstacles import around_function, standing_function
from balloon_warp.kernels.schedules.pushes import is_touched, pushed
from balloon_warp.kernels.schedules.warps import next_place
from balloon_warp.kernels.schedules.working import Working
from balloon_warp.kernels.substep import drift_symplectic
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits


@wp.func
def turn_of(t: Tables, time_in_frame: float):
    """0 or 1, by the substep that begins at a time."""
    return wp.int32(time_in_frame / t.step_seconds + 0.5) & 1


@wp.func
def put_off(working: Working, world: wp.int32, particle: wp.int32, turn: wp.int32):
    """By any thread in any order."""
    working.later[world, next_place(working.later_counts, world, turn)] = particle


@cache
def later_functions(traits: Traits) -> tuple[Any, Any, Any]:
    """The functions that say whether a particle has to be put off, and where it waits, and the one that ends its
    substep."""
    stand = standing_function(traits)
    around_own = around_function(traits)

    @wp.func
    def waits(t: Tables, working: Working, own: Any, time: float, point: wp.vec3):
        """Whether contacts push it, or it may stand on something, in a substep that ends at a time.

        Args:
            point: where it would be then without.
        """
        later = bool(False)
        if wp.static(traits.pushes_come_last):
            later = is_touched(working, own.world, own.number)
        if wp.static(traits.stands_on_fixtures):
            later = later or (own.mass > 0.0 and not is_free(t, own.world, own.number, time, point))
        if wp.static(traits.ground):
            later = later or wp.dot(point, t.up) < around_own(own, time).ground_height
        return later

    @wp.func
    def waiting_at(start: wp.vec3, point: wp.vec3):
        """Where it was, or is by the old velocity."""
        if wp.static(traits.forward_euler):
            return point
        else:
            return start

    @wp.func
    def end_later(t: Tables, working: Working, own: Any, gain: float, time: float, point: wp.vec3, velocity: wp.vec3):
        """Its point and velocity at the end of a substep that ends at a time.

        Args:
            gain: see `response`.
            point: where it waits.
        """
        if wp.static(traits.pushes_come_last):
            velocity = pushed(working, own, gain, velocity)
        if wp.static(not traits.forward_euler):
            point = drift_symplectic(point, velocity, velocity, t.step_seconds)
        if wp.static(traits.stands):
            if own.mass > 0.0:
                left, slowed = stand(t, around_own(own, time), point, velocity)
                point = left
                velocity = slowed
        return point, velocity

    return waits, waiting_at, end_later

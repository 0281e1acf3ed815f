"""Particles that contacts push, or that may meet an obstacle, are put off: they end their substep when all have moved,
one beside the other. A warp in which one of them moves among others that meet nothing would go its way with it.

Such a particle goes from where it was by its whole velocity: float32 rounds a way there and back again, and what stands
under load would tremble.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.forces import pushed
from balloon_warp.kernels.loops.fixture_looks import is_free
from balloon_warp.kernels.loops.obstacles import around_function, standing_function
from balloon_warp.kernels.phases.move import drift_symplectic
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.working import Working


@cache
def later_functions(traits: Traits) -> tuple[Any, Any, Any]:
    """The functions that say whether a particle may stand on something, and from where it goes on if it is put off, and
    the one that ends its substep."""
    stand = standing_function(traits)
    around_own = around_function(traits)

    @wp.func
    def may_stand(t: Tables, own: Any, time: float, point: wp.vec3):
        """In a substep that ends at a time.

        Args:
            point: where it would be then without.
        """
        near = bool(False)
        if wp.static(traits.stands_on_fixtures):
            near = own.mass > 0.0 and not is_free(t, own.world, own.number, time, point)
        if wp.static(traits.ground):
            near = near or wp.dot(point, t.up) < around_own(own, time).ground_height
        return near

    @wp.func
    def from_where(start: wp.vec3, point: wp.vec3):
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
            point: from where it goes on.
            velocity: without contacts.
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

    return may_stand, from_where, end_later

"""Early test whether a particle, or any of eight, may come to the ground, a sphere or an obstacle; most do not.

What is near is then asked one by one, so that this may say yes where nothing is met, but never no where something is.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import reach_along, scaled, squared_length
from balloon_warp.kernels.lanes import Lanes, Lanes3, any_negative
from balloon_warp.kernels.laws.impulse import NEAR
from balloon_warp.kernels.loops.fixture_looks import is_free
from balloon_warp.kernels.loops.fixture_poses import center_function
from balloon_warp.kernels.spheres import sphere_in_state
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits

WIDER = wp.constant(1.1)
"""(a + b)^2 is at most 1.1 a^2 + 11 b^2: so that no root is needed to see who is near"""
A_STEP = wp.constant(11.0)


@wp.struct
class Solids:
    """Spheres, and after them obstacles, of eight worlds, or of one in all lanes; a row for each group."""

    centers: wp.array2d[Lanes3]
    motions: wp.array2d[Lanes3]
    """Velocities of solids [m/s]"""
    reaches: wp.array2d[Lanes]
    """Squared distances from their centers within which contact is possible [m^2]"""


@cache
def solid_function(traits: Traits) -> Any:
    """Return the function for center, velocity and squared reach of a sphere or an obstacle."""
    center_at = center_function(traits) if traits.stands_on_fixtures else None

    @wp.func
    def solid_at(t: Tables, state: WorldState, world: wp.int32, solid: wp.int32, end: float):
        """Return a solid at the end of a step."""
        spheres = state.sphere_positions.shape[1]
        center = wp.vec3()
        motion = wp.vec3()
        reach = float(0.0)
        if solid < spheres:
            place, velocity, radius = sphere_in_state(t, state, world, solid)
            center = place
            motion = velocity
            reach = radius * radius
            if wp.static(traits.impulses):
                reach = (WIDER * NEAR * NEAR) * reach
        elif wp.static(center_at is not None):
            center = center_at(t, world, solid - spheres, end)
            reach = t.fixtures.solids[solid - spheres].reach + t.fixtures.fastest * t.step_seconds
            reach = WIDER * reach * reach
        return center, motion, reach

    return solid_at


@cache
def near_function(traits: Traits) -> Any:
    """Return the function that returns whether any of the particles, which have velocities, may touch a solid."""
    height = traits.columns.places["ground_height"]

    @wp.func
    def is_near(t: Any, solids: Solids, own: Any, point: Any, velocity: Any):
        found = bool(False)
        if wp.static(traits.ground):
            found = any_negative(reach_along(point, t.up) - own.n[height])
        a_step = A_STEP * t.step_seconds * t.step_seconds
        for solid in range(solids.centers.shape[1]):
            gaps = squared_length(point - solids.centers[own.group, solid]) - solids.reaches[own.group, solid]
            if wp.static(traits.impulses or traits.stands_on_fixtures):
                gaps = gaps - a_step * squared_length(velocity - solids.motions[own.group, solid])
            found = found or any_negative(gaps)
        return found

    return is_near


@cache
def standing_test(traits: Traits) -> Any:
    """Return the function that returns whether one particle may touch an obstacle or the ground.

    It goes by what the particle saw last.
    """
    height = traits.columns.places["ground_height"]

    @wp.func
    def may_stand(t: Tables, own: Any, end: float, point: wp.vec3):
        near = own.mass > 0.0 and not is_free(t, own.world, own.number, end, point)
        if wp.static(traits.ground):
            near = near or wp.dot(point, t.up) < own.n[height]
        return near

    return may_stand


def near_solids(traits: Traits, look: Any) -> Any:
    """Return the near-solid test for phases after a particle has moved, of one or of eight.

    Of one it is asked only where nothing but obstacles and the ground is left, and looking for obstacles costs much.
    """
    if look.world:
        return near_function(traits)
    alone = traits.stands_on_fixtures and not (traits.impulses or traits.penalties)
    return standing_test(traits) if alone else None


def heads_for_solids(traits: Traits, look: Any) -> Any:
    """Return the near-solid test for phases before a particle moves, by its expected course."""
    is_near = near_function(traits)

    @wp.func
    def is_heading(t: Any, solids: Solids, own: Any, point: Any, course: Any):
        return is_near(t, solids, own, point + scaled(course, t.step_seconds), course)

    return is_heading

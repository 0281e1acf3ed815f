"""Early test whether a particle, or any of eight, may come to the ground, a sphere or an obstacle; most do not.

Near solids are then checked one by one, so that this test may have false positives, but no false negatives.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import reach_along, scaled, squared_length
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import Lanes, Lanes3, any_negative
from balloon_warp.kernels.laws.impulse import NEAR
from balloon_warp.kernels.loops.fixture_looks import is_free
from balloon_warp.kernels.loops.fixture_poses import center_function
from balloon_warp.kernels.spheres import sphere_at
from balloon_warp.kernels.tables import Tables, WorldState

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
def solid_function(features: Features) -> Any:
    """Return the function for center, velocity and squared reach of a sphere or an obstacle."""
    center_at = center_function(features) if features.stands_on_fixtures else None

    @wp.func
    def solid_at(t: Tables, state: WorldState, world: wp.int32, solid: wp.int32, end: float):
        """Return a solid at the end of a step."""
        spheres = state.sphere_positions.shape[1]
        center = wp.vec3()
        motion = wp.vec3()
        reach = float(0.0)
        if solid < spheres:
            place, velocity, radius = sphere_at(t, state, world, solid)
            center = place
            motion = velocity
            reach = radius * radius
            if wp.static(features.impulses):
                reach = (WIDER * NEAR * NEAR) * reach
        elif wp.static(center_at is not None):
            center = center_at(t, world, solid - spheres, end)
            reach = t.fixtures.solids[solid - spheres].reach + t.fixtures.fastest * t.step_seconds
            reach = WIDER * reach * reach
        return center, motion, reach

    return solid_at


@cache
def near_function(features: Features) -> Any:
    """Return the function that returns whether any of the particles, which have velocities, may touch a solid."""
    height = features.columns.places["ground_height"]

    @wp.func
    def is_near(t: Any, solids: Solids, params: Any, point: Any, velocity: Any):
        found = bool(False)
        if wp.static(features.ground):
            found = any_negative(reach_along(point, t.up) - params.n[height])
        a_step = A_STEP * t.step_seconds * t.step_seconds
        for solid in range(solids.centers.shape[1]):
            gaps = squared_length(point - solids.centers[params.group, solid]) - solids.reaches[params.group, solid]
            if wp.static(features.impulses or features.stands_on_fixtures):
                gaps = gaps - a_step * squared_length(velocity - solids.motions[params.group, solid])
            found = found or any_negative(gaps)
        return found

    return is_near


@cache
def standing_test(features: Features) -> Any:
    """Return the function that returns whether one particle may touch an obstacle or the ground.

    It goes by the particle's last look.
    """
    height = features.columns.places["ground_height"]

    @wp.func
    def may_stand(t: Tables, params: Any, end: float, point: wp.vec3):
        near = params.mass > 0.0 and not is_free(t, params.world, params.number, end, point)
        if wp.static(features.ground):
            near = near or wp.dot(point, t.up) < params.n[height]
        return near

    return may_stand


def near_solids(features: Features, look: Any) -> Any:
    """Return the near-solid test for phases after a particle has moved, of one or of eight.

    A single one is checked only where nothing but obstacles and the ground is left, and looking for obstacles costs
    much.
    """
    if look.world:
        return near_function(features)
    alone = features.stands_on_fixtures and not (features.impulses or features.penalties)
    return standing_test(features) if alone else None


def heads_for_solids(features: Features, look: Any) -> Any:
    """Return the near-solid test for phases before a particle moves, by its expected course."""
    is_near = near_function(features)

    @wp.func
    def is_heading(t: Any, solids: Solids, params: Any, point: Any, course: Any):
        return is_near(t, solids, params, point + scaled(course, t.step_seconds), course)

    return is_heading

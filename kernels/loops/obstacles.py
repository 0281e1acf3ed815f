"""Solids that a particle may touch: spheres, the ground, and obstacles.

Early test whether a particle, or any of eight, may come to the ground, a sphere or an obstacle; most do not.

Near solids are then checked one by one, so that this test may have false positives, but no false negatives.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import reach_along, scaled, squared_length
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import Lanes, Lanes3, any_negative
from balloon_warp.kernels.laws.contact import (
    MOST_TURNS,
    is_settled,
    leave_ground,
    leave_sphere,
    out_of_sphere,
    penalty_force,
)
from balloon_warp.kernels.laws.impulse import NEAR_BODY
from balloon_warp.kernels.loops.fixtures import (
    GROUND,
    NOBODY,
    ON_GROUND,
    SEVERAL,
    Around,
    center_function,
    fixture_functions,
    forget_look,
    friction_on,
    is_free,
    with_another,
)
from balloon_warp.kernels.spheres import sphere_at
from balloon_warp.kernels.tables import Tables, WorldState, sphere_penalty
from balloon_warp.kernels.warps import add_quanta

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
                reach = (WIDER * NEAR_BODY * NEAR_BODY) * reach
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


@cache
def around_function(features: Features) -> Any:
    """Return the function that returns a particle's surroundings, from its own parameters."""
    height_column = features.columns.places["ground_height"]

    @wp.func
    def around_particle(params: Any, time: float):
        """Return the surroundings of a particle at the end of a step [s]."""
        around = Around()
        around.world = params.world
        around.particle = params.number
        around.ground_height = params.n[height_column]
        around.balloon = params.balloon
        around.time = time
        return around

    return around_particle


@cache
def standing_function(features: Features) -> Any:
    """Return the function that holds a particle out of the ground and obstacles."""
    leave_fixtures = fixture_functions(features)[0] if features.stands_on_fixtures else None

    @wp.func
    def stand(
        t: Tables,
        around: Around,
        point: wp.vec3,
        velocity: wp.vec3,
    ):
        """Return a particle's point and velocity outside of all obstacles.

        Most particles are above the ground and return at once. Where one obstacle may have pushed it into another, all
        take another turn. If they do not agree, the particle stays at its previous place, outside of resting obstacles.
        Where several have moved it, they begin anew, and stop all of its approach at once.
        """
        start = point - t.step_seconds * velocity
        came = point
        before = velocity
        partner = NOBODY
        at_once = bool(False)
        turns = wp.int32(0)
        while turns < MOST_TURNS:
            turns += 1
            end = point
            again = bool(False)
            if wp.static(features.stands_on_fixtures):
                left, slowed, met, crowded = leave_fixtures(t, around, start, point, velocity, at_once)
                point = left
                velocity = slowed
                again = met != NOBODY and crowded
                partner = with_another(partner, met)
            if wp.static(features.ground):
                if wp.dot(point, t.up) < around.ground_height:
                    friction = friction_on(t, around.world, around.balloon, GROUND)
                    stood, after = leave_ground(
                        point, velocity, t.up, around.ground_height, friction, t.step_seconds, at_once
                    )
                    point = stood
                    velocity = after
                    if wp.static(features.stands_on_fixtures):
                        partner = with_another(partner, ON_GROUND)
                        again = not (
                            is_free(t, around.world, around.particle, around.time, start)
                            and is_free(t, around.world, around.particle, around.time, point)
                        )
            if not again or is_settled(start, end, point):
                turns = MOST_TURNS
            elif wp.static(features.stands_on_fixtures):
                forget_look(t, around.world, around.particle)
                if wp.static(not features.fixtures_move):
                    if turns == MOST_TURNS:
                        point = start
            if wp.static(features.stands_on_fixtures):
                if turns == MOST_TURNS and partner == SEVERAL and not at_once:
                    forget_look(t, around.world, around.particle)
                    at_once = True
                    turns = 0
                    point = came
                    velocity = before
        return point, velocity

    return stand


@cache
def obstacle_loop(features: Features, sphere_at: Any) -> Any:
    """Return the function that moves a particle out of the ground, obstacles, and by the paper's rule spheres."""
    stand, spheres_there = standing_function(features), features.spheres

    @wp.func
    def leave_obstacles(
        t: Tables,
        spheres: Any,
        around: Around,
        point: wp.vec3,
        velocity: wp.vec3,
        inflation: wp.vec3,
    ):
        """Return a particle's point and velocity outside of all solids at the end of a step.

        Each sphere gets its force.
        """
        if wp.static(features.penalties):
            for sphere in range(spheres_there):
                center, motion, radius = sphere_at(t, spheres, around.world, sphere)
                if wp.length_sq(point - center) < radius * radius:
                    out, stopped, outward = leave_sphere(point, velocity, center, motion, radius, t.up, t.step_seconds)
                    point = out
                    velocity = stopped
                    push = penalty_force(sphere_penalty(t.spheres, around.world, sphere), inflation, outward)
                    add_quanta(spheres.sphere_quanta, around.world, sphere, push)
        if wp.static(features.stands):
            stood, slowed = stand(t, around, point, velocity)
            point = stood
            velocity = slowed
        return point, velocity

    return leave_obstacles


@cache
def detour_function(features: Features, sphere_at: Any) -> Any:
    """Return the function that foresees how obstacles deflect a particle."""
    out_of_fixtures = fixture_functions(features)[1] if features.stands_on_fixtures else None
    spheres_there = features.spheres

    @wp.func
    def detour_beside_obstacles(t: Tables, spheres: Any, around: Around, point: wp.vec3, velocity: wp.vec3):
        """Return the velocity change of a particle by obstacles in a step, and the normal of the last that it meets.

        Zero if it meets none.
        """
        end = point + t.step_seconds * velocity
        outside = end
        normal = wp.vec3()
        if wp.static(features.spheres > 0):
            for sphere in range(spheres_there):
                center, _motion, radius = sphere_at(t, spheres, around.world, sphere)
                out, outward = out_of_sphere(outside, normal, center, radius, t.up)
                outside = out
                normal = outward
        if wp.static(features.stands_on_fixtures):
            out, outward = out_of_fixtures(t, around, point, outside, velocity, normal)
            outside = out
            normal = outward
        if wp.static(features.ground):
            if wp.dot(outside, t.up) < around.ground_height:
                friction = friction_on(t, around.world, around.balloon, GROUND)
                stood, _slowed = leave_ground(
                    outside, velocity, t.up, around.ground_height, friction, t.step_seconds, False
                )
                outside = stood
                normal = t.up
        return (outside - end) / t.step_seconds, normal

    return detour_beside_obstacles

"""Solids that a particle may touch: spheres, wherever they are kept, the ground, and obstacles."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.fixed_point import add_quanta
from balloon_warp.kernels.laws.contact import (
    leave_ground,
    leave_sphere,
    out_of_sphere,
    penalty_force,
)
from balloon_warp.kernels.laws.fixture import MOST_TURNS, is_settled
from balloon_warp.kernels.loops.fixture_looks import forget_look, is_free
from balloon_warp.kernels.loops.fixtures import (
    NOBODY,
    ON_GROUND,
    SEVERAL,
    Around,
    fixture_functions,
    with_another,
)
from balloon_warp.kernels.loops.friction import GROUND, friction_on
from balloon_warp.kernels.tables import Tables, sphere_penalty


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

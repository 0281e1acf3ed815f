"""Adjoints of contact with solids: the ground alone, which costs less, obstacles, or spheres before these."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint, NoAdjointError
from balloon_warp.kernels.adjoints.ground import (
    detour_of_ground_backwards,
    foresee_ground_backwards,
    ground_backwards,
    ground_columns,
    leave_ground_backwards,
)
from balloon_warp.kernels.adjoints.obstacles import (
    detour_adjoint,
    foresee_obstacles_backwards,
    leave_obstacles_backwards,
    standing_adjoint,
)
from balloon_warp.kernels.adjoints.one_contact import BarsOfContact
from balloon_warp.kernels.adjoints.spheres import (
    foreseen_spheres_adjoint,
    leaving_spheres_adjoint,
    past_spheres_function,
)
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.fixtures import Around
from balloon_warp.kernels.loops.obstacles import around_function
from balloon_warp.kernels.loops.sphere_contact import is_near_sphere
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.phase import Look, Phase
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working


def leave_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of leaving solids."""
    require_no_bodies(features)
    if features.impulses:
        return leave_or_wait_backwards(features, look)
    if features.spheres:
        return leave_spheres_and_more_backwards(features, look)
    back = leave_obstacles_backwards if features.stands_on_fixtures else leave_ground_backwards
    return back(phase, features, look)


def foresee_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of the deflection by solids that a particle will meet."""
    require_no_bodies(features)
    if features.spheres:
        return foresee_spheres_and_more_backwards(features, look)
    back = foresee_obstacles_backwards if features.stands_on_fixtures else foresee_ground_backwards
    return back(phase, features, look)


def require_no_bodies(features: Features) -> None:
    """Check that all that particles leave has an adjoint.

    Raises:
        NoAdjointError: it has not.
    """
    if features.bodies:
        raise NoAdjointError("free bodies")


@wp.func
def stand_on_ground_backwards(
    t: Tables, working: Working, around: Around, point: wp.vec3, velocity: wp.vec3, point_bar: wp.vec3,
    velocity_bar: wp.vec3,
):  # fmt: skip
    """Return the derivatives by the state with which a particle comes to the ground, where there is nothing else."""
    return ground_backwards(t, around, point, velocity, point_bar, velocity_bar)


@wp.func
def detour_beside_ground_backwards(
    t: Tables, working: Working, around: Around, start: wp.vec3, ahead: wp.vec3, course: wp.vec3, place_bar: wp.vec3,
    normal_bar: wp.vec3,
):  # fmt: skip
    """Return the derivatives by a place ahead, where there is nothing but the ground."""
    return detour_of_ground_backwards(t, around, start, ahead, course, place_bar, normal_bar)


@cache
def standing_functions(features: Features) -> tuple[Any, Any]:
    """Return the functions that run contact with obstacles and the ground backwards, as it is and as it is foreseen."""
    if features.stands_on_fixtures:
        return standing_adjoint(features), detour_adjoint(features)
    if features.ground:
        return stand_on_ground_backwards, detour_beside_ground_backwards

    @wp.func
    def fly_backwards(
        t: Tables, working: Working, around: Around, point: wp.vec3, velocity: wp.vec3, point_bar: wp.vec3,
        velocity_bar: wp.vec3,
    ):  # fmt: skip
        bars = BarsOfContact()
        bars.point = point_bar
        bars.velocity = velocity_bar
        return bars

    @wp.func
    def no_detour_backwards(
        t: Tables, working: Working, around: Around, start: wp.vec3, ahead: wp.vec3, course: wp.vec3,
        place_bar: wp.vec3, normal_bar: wp.vec3,
    ):  # fmt: skip
        bars = BarsOfContact()
        bars.point = place_bar
        bars.normal = normal_bar
        return bars

    return fly_backwards, no_detour_backwards


def leave_spheres_and_more_backwards(features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of leaving spheres, and then obstacles and the ground."""
    column, friction_column = ground_columns(features)
    around_particle, stand_backwards = around_function(features), standing_functions(features)[0]
    past_spheres = past_spheres_function(look.sphere_at)
    leave_spheres_backwards = leaving_spheres_adjoint(features, look.sphere_at)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def leave_adjoint(
        t: Tables, spheres: Any, working: Working, params: Any, end: float, point: wp.vec3, velocity: wp.vec3,
        inflation: wp.vec3, point_bar: wp.vec3, velocity_bar: wp.vec3,
    ):  # fmt: skip
        params_bar = Params()
        if params.mass <= 0.0:
            return point_bar, velocity_bar, wp.vec3(), params_bar
        out, after, _met = past_spheres(t, spheres, params.world, t.spheres.numbers.shape[1], point, velocity)
        stood = stand_backwards(t, working, around_particle(params, end), out, after, point_bar, velocity_bar)
        params_bar.n[column] = stood.height
        params_bar.n[friction_column] = stood.friction
        bars = leave_spheres_backwards(
            t, spheres, working, params.world, params.number, point, velocity, inflation, stood.point, stood.velocity
        )
        return bars.point, bars.velocity, bars.inflation, params_bar

    return (Adjoint(leave_adjoint, ("point", "velocity", "inflation", "params")),)


def leave_or_wait_backwards(features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of leaving obstacles and the ground, unless a particle is near a sphere: then it waits."""
    column, friction_column = ground_columns(features)
    around_particle, stand_backwards = around_function(features), standing_functions(features)[0]
    sphere_at = look.sphere_at
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def leave_adjoint(
        t: Tables, spheres: Any, working: Working, params: Any, end: float, point: wp.vec3, velocity: wp.vec3,
        point_bar: wp.vec3, velocity_bar: wp.vec3,
    ):  # fmt: skip
        params_bar = Params()
        waits = params.mass <= 0.0
        for sphere in range(t.spheres.numbers.shape[1]):
            center, motion, radius = sphere_at(t, spheres, params.world, sphere)
            waits = waits or is_near_sphere(t, center, motion, radius, point, velocity)
        if waits:
            return point_bar, velocity_bar, params_bar
        stood = stand_backwards(t, working, around_particle(params, end), point, velocity, point_bar, velocity_bar)
        params_bar.n[column] = stood.height
        params_bar.n[friction_column] = stood.friction
        return stood.point, stood.velocity, params_bar

    return (Adjoint(leave_adjoint, ("point", "velocity", "params")),)


def foresee_spheres_and_more_backwards(features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of the deflection by spheres, and then by obstacles and the ground."""
    column, friction_column = ground_columns(features)
    around_particle, detour_backwards = around_function(features), standing_functions(features)[1]
    past_spheres = past_spheres_function(look.sphere_at)
    foresee_spheres_backwards = foreseen_spheres_adjoint(features, look.sphere_at)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def foresee_adjoint(
        t: Tables, spheres: Any, working: Working, params: Any, end: float, gain: float, point: wp.vec3,
        course: wp.vec3, detour_bar: wp.vec3, away_bar: wp.vec3,
    ):  # fmt: skip
        params_bar = Params()
        by_point = wp.vec3()
        by_course = wp.vec3()
        if gain > 0.0:
            ahead = point + t.step_seconds * course
            outside, _after, _met = past_spheres(t, spheres, params.world, t.spheres.numbers.shape[1], ahead, wp.vec3())
            by_way = detour_bar / t.step_seconds
            stood = detour_backwards(t, working, around_particle(params, end), point, outside, course, by_way, away_bar)
            by_ahead = foresee_spheres_backwards(
                t, spheres, working, params.world, params.number, ahead, stood.point, stood.normal
            )
            by_point = stood.start + (by_ahead - by_way)
            by_course = stood.velocity + t.step_seconds * (by_ahead - by_way)
            params_bar.n[column] = stood.height
            params_bar.n[friction_column] = stood.friction
        return by_point, by_course, params_bar

    return (Adjoint(foresee_adjoint, ("point", "course", "params")),)

"""Adjoints of contact with the ground: which particles touch it, and whether friction holds them, is frozen."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.adjoints.one_contact import BarsOfContact, work_on_ground
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import leave_ground
from balloon_warp.kernels.loops.fixtures import Around
from balloon_warp.kernels.loops.friction import GROUND, friction_on
from balloon_warp.kernels.loops.obstacles import around_function
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.phase import Look, Phase
from balloon_warp.kernels.tables import Tables


def ground_columns(features: Features) -> tuple[int, int]:
    """Return the columns of the ground's height, and of a balloon's own coefficient of friction."""
    return features.columns.places["ground_height"], features.columns.places["balloon_friction"]


@wp.func
def ground_backwards(
    t: Tables, around: Around, point: wp.vec3, velocity: wp.vec3, point_bar: wp.vec3, velocity_bar: wp.vec3
):
    """Return the derivatives by the state with which a particle comes to the ground."""
    bars = BarsOfContact()
    bars.point = point_bar
    bars.velocity = velocity_bar
    if wp.dot(point, t.up) < around.ground_height:
        friction = friction_on(t, around.world, around.balloon, GROUND)
        by_point, by_velocity, _up, by_height, by_friction, _step, _once, _bar, _v_bar = wp.grad(work_on_ground)(
            point, velocity, t.up, around.ground_height, friction, t.step_seconds, False, point_bar, velocity_bar
        )
        bars.point = by_point
        bars.velocity = by_velocity
        bars.height = by_height
        bars.friction = by_friction
    return bars


@wp.func
def detour_of_ground_backwards(
    t: Tables, around: Around, start: wp.vec3, ahead: wp.vec3, course: wp.vec3, place_bar: wp.vec3, normal_bar: wp.vec3
):
    """Return the derivatives by a place ahead, by the course, and by the normal of the surface met before."""
    bars = ground_backwards(t, around, ahead, course, place_bar, wp.vec3())
    if wp.dot(ahead, t.up) >= around.ground_height:
        bars.normal = normal_bar
    return bars


@wp.func
def work_of_detour(
    point: wp.vec3, course: wp.vec3, up: wp.vec3, height: float, friction: float, step_seconds: float, bar: wp.vec3
):
    """Return the velocity change that the ground will bring, see `loops.obstacles.detour_function`, times a bar."""
    end = point + step_seconds * course
    outside, _slowed = leave_ground(end, course, up, height, friction, step_seconds, False)
    return wp.dot(outside - end, bar) / step_seconds


def leave_ground_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of leaving the ground."""
    column, friction_column = ground_columns(features)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    around_particle = around_function(features)

    @wp.func
    def leave_adjoint(
        t: Tables, params: Any, point: wp.vec3, velocity: wp.vec3, point_bar: wp.vec3, velocity_bar: wp.vec3
    ):
        params_bar = Params()
        bars = BarsOfContact()
        bars.point = point_bar
        bars.velocity = velocity_bar
        if params.mass > 0.0:
            bars = ground_backwards(t, around_particle(params, 0.0), point, velocity, point_bar, velocity_bar)
            params_bar.n[column] = bars.height
            params_bar.n[friction_column] = bars.friction
        return bars.point, bars.velocity, params_bar

    return (Adjoint(leave_adjoint, ("point", "velocity", "params")),)


def foresee_ground_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of the deflection that a particle will meet; the direction from the ground is constant."""
    column, friction_column = ground_columns(features)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def foresee_adjoint(t: Tables, params: Any, gain: float, point: wp.vec3, course: wp.vec3, detour_bar: wp.vec3):
        params_bar = Params()
        point_bar = wp.vec3()
        course_bar = wp.vec3()
        height = params.n[column]
        if gain > 0.0 and wp.dot(point + t.step_seconds * course, t.up) < height:
            friction = friction_on(t, params.world, params.balloon, GROUND)
            by_point, by_course, _up, by_height, by_friction, _step, _bar = wp.grad(work_of_detour)(
                point, course, t.up, height, friction, t.step_seconds, detour_bar
            )
            point_bar = by_point
            course_bar = by_course
            params_bar.n[column] = by_height
            params_bar.n[friction_column] = by_friction
        return point_bar, course_bar, params_bar

    return (Adjoint(foresee_adjoint, ("point", "course", "params")),)

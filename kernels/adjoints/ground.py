"""Adjoints of contact with the ground: which particles touch it, and whether friction holds them, is frozen."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint, NoAdjointError
from balloon_warp.kernels.laws.contact import leave_ground
from balloon_warp.kernels.loops.friction import GROUND, friction_on
from balloon_warp.kernels.own import own_functions
from balloon_warp.kernels.phase import Look, Phase
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits


def _require_ground_alone(traits: Traits) -> None:
    if traits.spheres:
        raise NoAdjointError("spheres")
    if traits.stands_on_fixtures:
        raise NoAdjointError("obstacles")
    if traits.bodies:
        raise NoAdjointError("free bodies")


@wp.func
def work_of_ground(
    point: wp.vec3, velocity: wp.vec3, up: wp.vec3, height: float, friction: float, step_seconds: float,
    point_bar: wp.vec3, velocity_bar: wp.vec3,
):  # fmt: skip
    """Return where a particle leaves the ground and its velocity, times their bars."""
    out, after = leave_ground(point, velocity, up, height, friction, step_seconds)
    return wp.dot(out, point_bar) + wp.dot(after, velocity_bar)


@wp.func
def work_of_detour(
    point: wp.vec3, course: wp.vec3, up: wp.vec3, height: float, friction: float, step_seconds: float, bar: wp.vec3
):
    """Return the velocity change that the ground will bring, see `loops.obstacles.detour_function`, times a bar."""
    end = point + step_seconds * course
    outside, _slowed = leave_ground(end, course, up, height, friction, step_seconds)
    return wp.dot(outside - end, bar) / step_seconds


def leave_backwards(phase: Phase, traits: Traits, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of leaving the ground."""
    _require_ground_alone(traits)
    column = traits.columns.places["ground_height"]
    Own, _ = own_functions(traits.columns, traits.balloons)  # noqa: N806 - a type

    @wp.func
    def leave_adjoint(
        t: Tables, own: Any, point: wp.vec3, velocity: wp.vec3, point_bar: wp.vec3, velocity_bar: wp.vec3
    ):
        own_bar = Own()
        before = point_bar
        before_velocity = velocity_bar
        height = own.n[column]
        if own.mass > 0.0 and wp.dot(point, t.up) < height:
            friction = friction_on(t, own.world, own.balloon, GROUND)
            by_point, by_velocity, _up, by_height, _friction, _step, _bar, _velocity_bar = wp.grad(work_of_ground)(
                point, velocity, t.up, height, friction, t.step_seconds, point_bar, velocity_bar
            )
            before = by_point
            before_velocity = by_velocity
            own_bar.n[column] = by_height
        return before, before_velocity, own_bar

    return (Adjoint(leave_adjoint, ("point", "velocity", "own")),)


def foresee_backwards(phase: Phase, traits: Traits, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of the deflection that a particle will meet; the direction from the ground is constant."""
    _require_ground_alone(traits)
    column = traits.columns.places["ground_height"]
    Own, _ = own_functions(traits.columns, traits.balloons)  # noqa: N806 - a type

    @wp.func
    def foresee_adjoint(t: Tables, own: Any, gain: float, point: wp.vec3, course: wp.vec3, detour_bar: wp.vec3):
        own_bar = Own()
        point_bar = wp.vec3()
        course_bar = wp.vec3()
        height = own.n[column]
        if gain > 0.0 and wp.dot(point + t.step_seconds * course, t.up) < height:
            friction = friction_on(t, own.world, own.balloon, GROUND)
            by_point, by_course, _up, by_height, _friction, _step, _bar = wp.grad(work_of_detour)(
                point, course, t.up, height, friction, t.step_seconds, detour_bar
            )
            point_bar = by_point
            course_bar = by_course
            own_bar.n[column] = by_height
        return point_bar, course_bar, own_bar

    return (Adjoint(foresee_adjoint, ("point", "course", "own")),)

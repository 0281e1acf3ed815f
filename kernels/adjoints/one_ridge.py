"""Adjoint of one contact of a balloon's feature and a ridge, which Warp derives of the law's own functions.

Frozen is which they are, and whether they come too near.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.catch import Catch
from balloon_warp.kernels.contact.ridge_balls import ball_laws
from balloon_warp.kernels.contact.ridge_poses import Placed
from balloon_warp.kernels.contact.ridge_push import (
    BALL,
    Bearing,
    caught,
    excess_of,
    missing_of,
    move_of,
    push_functions,
)
from balloon_warp.kernels.contact.ridge_search import seen_from
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.ridges import Ridge


@wp.func
def moving_of(catch: Catch, moving: wp.mat33):
    """Return the velocity of a feature's point at a contact, of those of its corners, row by row [m/s]."""
    return catch.weights[0] * moving[0] + catch.weights[1] * moving[1] + catch.weights[2] * moving[2]


@wp.func
def work_of_gains(catch: Catch, bearing: Bearing, impulse: wp.vec3, worth: wp.mat33):
    """Return the gains of three corners by an impulse, times their bars."""
    by_gains = wp.vec3(wp.dot(impulse, worth[0]), wp.dot(impulse, worth[1]), wp.dot(impulse, worth[2]))
    return wp.dot(wp.cw_mul(catch.weights, bearing.eases), by_gains)


@wp.struct
class Motion:
    """Velocity and spin of a sphere, or the bars of gains of them."""

    velocity: wp.vec3
    spin: wp.vec3


@cache
def ridge_works(features: Features) -> tuple[Any, Any]:
    """Return the functions of the gains of corners and a sphere by a push, and by a parting, times their bars."""
    gain_along, impulse_of = push_functions(features)
    moving_of_ball, gains_of_ball = ball_laws(features)

    @wp.func
    def work_on_ball(catch: Catch, bearing: Bearing, impulse: wp.vec3, worth: Motion):
        """Return the gains of a sphere by an impulse on the balloon, times their bars."""
        gain, twist = gains_of_ball(bearing.mass, bearing.radius, -impulse, wp.cross(catch.arm, -impulse))
        return wp.dot(gain, worth.velocity) + wp.dot(twist, worth.spin)

    @wp.func
    def work_of_push(
        catch: Catch, moving: wp.mat33, ball: Motion, bearing: Bearing, step_seconds: float, worth: wp.mat33,
        of_ball: Motion,
    ):  # fmt: skip
        of_solid = catch.moving
        if wp.static(features.round_ridges):
            if bearing.kind == BALL:
                of_solid = moving_of_ball(ball.velocity, ball.spin, catch.arm)
        relative = moving_of(catch, moving) - of_solid
        impulse = impulse_of(catch, bearing, excess_of(catch, relative, step_seconds), relative)
        work = work_of_gains(catch, bearing, impulse, worth)
        if wp.static(features.round_ridges):
            if bearing.kind == BALL:
                work = work + work_on_ball(catch, bearing, impulse, of_ball)
        return work

    @wp.func
    def work_of_parting(catch: Catch, bearing: Bearing, worth: wp.mat33, of_ball: Motion):
        move = move_of(catch, gain_along(catch, bearing, catch.normal), missing_of(catch))
        work = work_of_gains(catch, bearing, move, worth)
        if wp.static(features.round_ridges):
            if bearing.kind == BALL:
                work = work + work_on_ball(catch, bearing, move, of_ball)
        return work

    return work_of_push, work_of_parting


@wp.func
def work_of_catch(
    points: wp.mat33, moving: wp.mat33, placed: Placed, ridge: Ridge, feature: wp.vec4i, step_seconds: float, by: Catch
):
    """Return a contact as a substep begins, times the derivatives by it; points and velocities of corners in rows."""
    starts = points - step_seconds * moving
    catch = caught(
        placed, ridge, feature, seen_from(placed, starts[0]), seen_from(placed, starts[1]), seen_from(placed, starts[2])
    )
    found = wp.dot(catch.weights, by.weights) + wp.dot(catch.normal, by.normal) + catch.gap * by.gap
    return found + wp.dot(catch.moving, by.moving) + wp.dot(catch.arm, by.arm)


@wp.func
def sum_of_catches(one: Catch, other: Catch):
    """Return the sum of derivatives by a contact."""
    total = Catch()
    total.weights = one.weights + other.weights
    total.normal = one.normal + other.normal
    total.gap = one.gap + other.gap
    total.moving = one.moving + other.moving
    total.arm = one.arm + other.arm
    return total

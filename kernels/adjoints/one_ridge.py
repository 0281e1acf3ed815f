"""Adjoint of one contact of a balloon's feature and a ridge, which Warp derives of the law's own functions.

Frozen is which they are, and whether they come too near.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.catch import Catch
from balloon_warp.kernels.contact.ridge_poses import Placed
from balloon_warp.kernels.contact.ridge_push import Bearing, caught, excess_of, missing_of, move_of, push_functions
from balloon_warp.kernels.contact.ridge_search import seen_from
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.ridges import Ridge


@wp.func
def moving_of(catch: Catch, moving: wp.mat33):
    """Return the velocity of a feature's point at a contact, of those of its corners, row by row [m/s]."""
    return catch.weights[0] * moving[0] + catch.weights[1] * moving[1] + catch.weights[2] * moving[2]


@wp.func
def work_of_gains(catch: Catch, bearing: Bearing, impulse: wp.vec3, worth: wp.mat33):
    """Return what an impulse gains three corners, times what that is worth."""
    by_gains = wp.vec3(wp.dot(impulse, worth[0]), wp.dot(impulse, worth[1]), wp.dot(impulse, worth[2]))
    return wp.dot(wp.cw_mul(catch.weights, bearing.eases), by_gains)


@cache
def ridge_works(features: Features) -> tuple[Any, Any]:
    """Return the functions of what a push and a parting do to a feature's corners, times what that is worth."""
    gain_along, impulse_of = push_functions(features)

    @wp.func
    def work_of_push(catch: Catch, moving: wp.mat33, bearing: Bearing, step_seconds: float, worth: wp.mat33):
        relative = moving_of(catch, moving) - catch.moving
        impulse = impulse_of(catch, bearing, excess_of(catch, relative, step_seconds), relative)
        return work_of_gains(catch, bearing, impulse, worth)

    @wp.func
    def work_of_parting(catch: Catch, bearing: Bearing, worth: wp.mat33):
        move = move_of(catch, gain_along(catch, bearing, catch.normal), missing_of(catch))
        return work_of_gains(catch, bearing, move, worth)

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
    return found + wp.dot(catch.moving, by.moving)


@wp.func
def sum_of_catches(one: Catch, other: Catch):
    """Return the sum of derivatives by a contact."""
    total = Catch()
    total.weights = one.weights + other.weights
    total.normal = one.normal + other.normal
    total.gap = one.gap + other.gap
    total.moving = one.moving + other.moving
    return total

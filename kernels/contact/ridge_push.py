"""Impulse between a balloon's feature and a ridge, see `laws.ridges`: of plain values, so that it can be derived."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.catch import Catch
from balloon_warp.kernels.contact.ridge_poses import Placed
from balloon_warp.kernels.contact.ridge_search import near_in
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.ridges import Ridge, approach_allowed, rub_against, way_to_part
from balloon_warp.kernels.laws.rigid import spin_of
from balloon_warp.kernels.laws.sliding import spin_by
from balloon_warp.kernels.laws.touch import LEAST

OBSTACLE, BODY, BALL = (wp.constant(kind) for kind in range(3))
"""Kinds of solids"""


@wp.struct
class Bearing:
    """Inverse masses that bear a contact, and numbers of contacts among which each is shared."""

    eases: wp.vec3  # of the corners [1/kg]
    shares: wp.vec3
    kind: wp.int32  # of the solid
    share: float  # contacts of a body or a sphere
    mass: float  # of that [kg]
    turn: wp.quat  # of a body as the substep begins
    ease: wp.mat33  # of a body, the inverse inertia tensor of 1 kg [1/m^2]
    radius: float  # of a sphere [m]


@wp.func
def caught(placed: Placed, ridge: Ridge, feature: wp.vec4i, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return the contact of a feature and a ridge of a solid.

    Args:
        a: corner of the feature, relative to the solid, as are b and c.
    """
    catch = Catch()
    near = near_in(placed, ridge, feature, a, b, c)
    catch.kept = placed.kept
    catch.weights = near.weights
    catch.gap = near.gap
    if wp.length_sq(near.normal) > 0.0:
        catch.normal = wp.quat_rotate(placed.turn, near.normal)
        inside = near.weights[0] * a + near.weights[1] * b + near.weights[2] * c
        catch.arm = wp.quat_rotate(placed.turn, inside)
        catch.moving = placed.velocity + wp.cross(placed.spin, catch.arm)
    return catch


@wp.func
def excess_of(catch: Catch, relative: wp.vec3, step_seconds: float):
    """Return the speed by which a contact comes nearer than it may [m/s].

    Args:
        relative: Velocity of the balloon beside the solid [m/s].
    """
    return -wp.dot(relative, catch.normal) - approach_allowed(catch.gap, catch.kept, step_seconds)


@wp.func
def missing_of(catch: Catch):
    """Return the displacement that a contact needs [m], where little of its distance is left."""
    return way_to_part(catch.gap, catch.kept)


@wp.func
def move_of(catch: Catch, along: wp.vec3, out: float):
    """Return the move of the balloon, times mass [kg m], that parts it from the solid by a displacement.

    Args:
        along: Displacement of both along the normal by 1 kg m [1/kg].
    """
    return (out / wp.max(wp.dot(along, catch.normal), LEAST)) * catch.normal


@cache
def push_functions(features: Features) -> tuple[Any, Any]:
    """Return the functions of a contact's gain by 1 N s, and of its impulse with friction."""

    @wp.func
    def gain_along(catch: Catch, bearing: Bearing, along: wp.vec3):
        """Return the inverse effective mass of the balloon's part and the solid along a unit vector [1/kg]."""
        ease = float(0.0)
        for corner in range(3):
            weight = catch.weights[corner]
            ease += weight * weight * bearing.shares[corner] * bearing.eases[corner]
        gain = ease * along
        if wp.static(features.bodies > 0):
            if bearing.kind == BODY:
                twist = spin_of(bearing.turn, bearing.ease, bearing.mass, wp.cross(catch.arm, along))
                gain += bearing.share * (along / bearing.mass + wp.cross(twist, catch.arm))
        if wp.static(features.round_ridges):
            if bearing.kind == BALL:
                of_ball = along / bearing.mass
                if wp.static(features.spheres_rub):
                    turning = spin_by(bearing.mass, bearing.radius, wp.cross(catch.arm, along))
                    of_ball += wp.cross(turning, catch.arm)
                gain += bearing.share * of_ball
        return gain

    @wp.func
    def impulse_of(catch: Catch, bearing: Bearing, excess: float, relative: wp.vec3):
        """Return the impulse on the balloon [N s] that takes a velocity along the normal, and friction.

        Args:
            relative: Velocity of the balloon beside the solid [m/s], where there is friction.
        """
        along = gain_along(catch, bearing, catch.normal)
        push = excess / wp.max(wp.dot(along, catch.normal), LEAST)
        impulse = push * catch.normal
        if catch.friction > 0.0:
            slide = relative + push * along
            slide = slide - wp.dot(slide, catch.normal) * catch.normal
            if wp.length_sq(slide) > 0.0:
                ahead = wp.normalize(slide)
                ease = wp.dot(gain_along(catch, bearing, ahead), ahead)
                impulse = impulse + rub_against(slide, catch.normal, ease, catch.friction * push)
        return impulse

    return gain_along, impulse_of

"""Collision of two spheres in a step: the time of impact, and the impulse.

The one sees the other come from s by the way w. They meet where |s + part w| is the sum R of their radii, along the
unit vector n there. With u how fast the other moves beside the one, an impulse along n makes

    n . u' = -e n . u    if they come nearer, e the restitution

and from there on they go at the new velocities. So momentum stays, and angular momentum, since n passes through both;
kinetic energy does not grow, as e <= 1, and neither does that of weight, which hangs on their common center of mass.
At any speed neither tunnels through the other: paths collide, not places.
"""

import warp as wp

from balloon_warp.kernels.laws.contact import way_out
from balloon_warp.kernels.laws.impulse import way_apart

NEVER = wp.constant(2.0)
"""Marker: time of impact, as a fraction of the step, that is never reached"""
SLOW = wp.constant(2.0)
"""Approach speed below which nothing rebounds, in steps of gravity, so that a sphere on another comes to rest"""


@wp.func
def part_until(start: wp.vec3, way: wp.vec3, reach: float):
    """Return the fraction of a path at which its distance from the origin is `reach`.

    It is 0 where the way begins nearer, and `NEVER` where it does not lead there.
    """
    away = wp.length(start)
    if away <= reach:
        return 0.0
    length = wp.length(way)
    part = float(NEVER)
    if length > 0.0:
        ahead = way / length
        along = -wp.dot(start, ahead)
        beside = start + along * ahead
        depth = reach * reach - wp.length_sq(beside)
        if along > 0.0 and depth > 0.0:
            # the nearer root, without a difference of large numbers
            part = (away - reach) * (away + reach) / (along + wp.sqrt(depth)) / length
    return wp.where(part <= 1.0, part, NEVER)


@wp.func
def mean_restitution(first: float, second: float):
    """Return the geometric mean of two coefficients of restitution: zero if one of them is zero."""
    return wp.sqrt(first * second)


@wp.func
def collision(
    start: wp.vec3,
    way: wp.vec3,
    relative: wp.vec3,
    reach: float,
    restitution: float,
    gravity: float,
    up: wp.vec3,
    step_seconds: float,
):
    """Shift [m] and gain [m/s] of a sphere beside another, along n, and the part of the step after which they meet.

    Overlapping spheres may not approach, and are separated slowly, without speed.

    Args:
        start: from the other's center, before the step.
        way: in the step, beside the other.
        relative: its velocity beside the other's.
        reach: the sum of the radii.
    """
    shift = wp.vec3()
    gain = wp.vec3()
    part = part_until(start, way, reach)
    if part <= 1.0:
        normal = way_out(start + part * way, wp.vec3(), up)
        approach = wp.max(-wp.dot(relative, normal), 0.0)
        bounce = 1.0 + wp.where(approach > SLOW * step_seconds * wp.abs(gravity), restitution, 0.0)
        gain = (bounce * approach) * normal
        gap = wp.min(wp.length(start) - reach, 0.0)
        least = reach + gap + way_apart(gap, step_seconds)
        further = wp.max(least - wp.dot(start + way, normal), 0.0)
        shift = (wp.where(gap < 0.0, 1.0, bounce) * further) * normal
    return shift, gain, part


@wp.func
def share_of(own: float, other: float):
    """Return one body's share of the relative velocity change of two bodies, from their masses [kg]."""
    return other / (own + other)

"""Contact of a sphere with a triangle of a balloon in a step: the time of impact, and the impulse.

With y the triangle's point nearest to the center c, of the corners' weights w_i, and n the unit vector from y to c, an
impulse along n stops the approach,

    n . (V' - sum w_i v_i') >= 0,

the sphere's and, by their weights, the corners'. It acts where |c - y| comes down to the radius, on straight ways, and
all go on from there at their new velocities: so momentum stays, and angular momentum, since n passes through both; and
kinetic energy does not grow. Springs and gas make it rebound.

Friction acts in the same moment, at the same point, see `laws.sliding`.

When they come so near is found in steps over which they cannot (conservative advancement: the distance falls by no more
than the center's way beside the corners'). The nearest point is on the side where the center is, and the center never
comes to the surface: so none changes sides, from outside or from within, at any speed, however small it is.
"""

import warp as wp

from balloon_warp.kernels.laws.collision import NEVER
from balloon_warp.kernels.laws.impulse import way_apart
from balloon_warp.kernels.laws.sliding import ease_of_ball, friction_impulse
from balloon_warp.kernels.laws.touch import nearest_weights, weighted

MOST_LOOKS = wp.constant(256)
"""Largest number of steps of conservative advancement of a sphere beside a triangle; if exceeded, the sphere stops"""
BAND = wp.constant(1.0e-3)
"""Distance at which a sphere counts as touching a triangle, over the radius"""
FREE = wp.constant(0.2)
"""Overlap that is tolerated before it is resolved, over the radius, since resolving it strains springs"""
KEPT = wp.constant(0.5)
"""Least fraction of the current distance that is kept after any displacement"""
SAME_WAY = wp.constant(0.5)
"""Least cosine between normals on straight and on deflected paths"""
LITTLE = wp.constant(1.0e-4)
"""Largest decrease of the distance in a step, over the radius"""
ROUNDING = wp.constant(5.0e-7)
"""Relative rounding error of a coordinate after a few operations"""
LEAST_RADIUS = wp.constant(1.0e-3)
"""Least radius of a sphere over a triangle's size, by the resolution of float32"""


@wp.struct
class Facing:
    """A sphere and a triangle in a step. Ways are straight, from the start to the end."""

    start: wp.vec3  # of the center [m]
    way: wp.vec3
    starts: wp.mat33  # of the corners, row by row
    ways: wp.mat33
    radius: float  # with which it meets triangles [m]
    own_radius: float


@wp.struct
class Impact:
    """Shifts [m] and gains [m/s] of a sphere and three corners by a contact.

    They are along its normal, and by friction across it.
    """

    normal: wp.vec3
    shifts: wp.vec4
    gains: wp.vec4
    pulled: wp.vec4  # gains of sphere and corners by 1 N s on the sphere [1/kg]
    rub: wp.vec3  # the impulse of friction on the sphere [N s]
    arm: wp.vec3  # from its center to where that acts [m]
    seconds: float  # of the step, after it


@wp.func
def facing_of(start: wp.vec3, end: wp.vec3, radius: float, starts: wp.mat33, ends: wp.mat33):
    """Return the configuration of center and corners before and after a step."""
    facing = Facing()
    facing.start = start
    facing.way = end - start
    facing.starts = starts
    facing.ways = ends - starts
    size = wp.length(starts[1] - starts[0]) + wp.length(starts[2] - starts[0])
    facing.radius = wp.max(radius, LEAST_RADIUS * size)
    facing.own_radius = radius
    return facing


@wp.func
def seen_at(facing: Facing, part: float):
    """Return the closest point's weights and the arm from it to the center, after a fraction of the step."""
    corners = facing.starts + part * facing.ways
    center = facing.start + part * facing.way
    weights = nearest_weights(center, corners[0], corners[1], corners[2])
    return weights, center - weighted(weights, corners[0], corners[1], corners[2])


@wp.func
def way_beside(facing: Facing, weights: wp.vec3):
    """Return the center's displacement relative to the triangle's point of these weights."""
    return facing.way - weighted(weights, facing.ways[0], facing.ways[1], facing.ways[2])


@wp.func
def longest_way(facing: Facing):
    """Return the longest way of the center beside a corner."""
    first = wp.length(facing.way - facing.ways[0])
    return wp.max(wp.max(first, wp.length(facing.way - facing.ways[1])), wp.length(facing.way - facing.ways[2]))


@wp.func
def part_after(part: float, distance: float, radius: float, longest: float):
    """Return the fraction of the step until which they cannot come nearer than a radius, from one of a given distance.

    No further than to half the distance, so that the center cannot be on the other side.
    """
    ahead = wp.max(distance - (1.0 - 0.5 * BAND) * radius, 0.5 * distance)
    return wp.where(ahead < longest and longest > 0.0, part + ahead / wp.max(longest, 1.0e-30), NEVER)


@wp.func
def part_until_contact(facing: Facing, radius: float):
    """Return the fraction of the step after which they come nearer than a radius; `NEVER` if they do not.

    Returns also the number of looks that this took.
    """
    longest = longest_way(facing)
    little = LITTLE * facing.radius + ROUNDING * wp.length(facing.start)
    part = float(0.0)
    found = float(NEVER)
    looks = wp.int32(0)
    while part <= 1.0 and found > 1.0:
        weights, arm = seen_at(facing, part)
        distance = wp.length(arm)
        nearer = -(1.0 - part) * wp.dot(way_beside(facing, weights), arm)
        if distance < radius and nearer > little * distance:
            found = part
        looks += 1
        if looks >= MOST_LOOKS:
            found = part
        part = part_after(part, distance, radius, longest)
    return found, looks


@wp.func
def impact(
    facing: Facing,
    part: float,
    velocity: wp.vec3,
    velocities: wp.mat33,
    eases: wp.vec4,
    spin: wp.vec3,
    friction: float,
    step_seconds: float,
):
    """Find the impact of a contact after a part of the step.

    Args:
        velocity: of the sphere.
        velocities: of the corners, row by row.
        eases: 1 over the masses of sphere and corners, 0 of one that is fixed [1/kg].
        spin: of the sphere [rad/s].
        friction: of both.
    """
    weights, arm = seen_at(facing, part)
    normal = wp.normalize(arm)
    nearest = wp.min(wp.length(arm), facing.radius)
    end = facing.start + facing.way
    end -= weighted(
        weights,
        facing.starts[0] + facing.ways[0],
        facing.starts[1] + facing.ways[1],
        facing.starts[2] + facing.ways[2],
    )
    beside = velocity - weighted(weights, velocities[0], velocities[1], velocities[2])
    rest_of_step = (1.0 - part) * step_seconds
    # where an earlier impact has bent the ways, angular momentum stays along the line through where both are then
    bent = end - rest_of_step * beside
    if wp.dot(bent, normal) > SAME_WAY * wp.length(bent):
        normal = wp.normalize(bent)
    gain = wp.max(-wp.dot(beside, normal), 0.0)
    shift = rest_of_step * gain
    gap = wp.dot(end, normal) + shift - (1.0 - FREE) * facing.radius
    if gap < 0.0:  # something else has moved them nearer
        out = wp.max(way_apart(gap, step_seconds), (KEPT * nearest - (1.0 - FREE) * facing.radius) - gap)
        shift += out
    pulled = wp.vec4(eases[0], -weights[0] * eases[1], -weights[1] * eases[2], -weights[2] * eases[3])
    whole = pulled[0] - wp.dot(weights, wp.vec3(pulled[1], pulled[2], pulled[3]))
    met = Impact()
    met.normal = normal
    met.shifts = (shift / whole) * pulled
    met.gains = (gain / whole) * pulled
    met.pulled = pulled
    met.arm = -bent
    met.seconds = rest_of_step
    ease = whole - eases[0] + ease_of_ball(1.0 / eases[0], facing.own_radius, bent)
    sliding = beside + gain * normal + wp.cross(spin, met.arm)
    met.rub = friction_impulse(sliding, normal, ease, friction * gain / whole)
    return met

"""Edges that meet edges: rims of open sheets and sharp seams, between whose particles none of the other's may be.

With p and q the nearest points of two edges as a substep begins, and n the unit vector from p to q, the ends of each
edge bear the contact by the weights of p or q, where they were, see `contact.contact`.

Friction is an impulse J across n at q and, opposite, at p. The torque of that, g n x J, is borne by couples along n at
the ends of the edges e_1 and e_2: impulses of -a and a, and of -b and b, with a e_1 + b e_2 = g J. Slip is measured
with the same weights, so that friction gives no energy.
"""

import warp as wp

from balloon_warp.kernels.laws.touch import LEAST

KEPT = wp.constant(0.5)
"""Distance d that edges keep, over the skin's thickness; surfaces at rest on each other keep more, see `laws.touch`"""
PARALLEL = wp.constant(1.0e-4)
"""Squared sine of the angle below which edges count as parallel"""
CROSSED = wp.constant(0.3)
"""Sine of the angle below which there is no friction, whose couples would be excessively large"""
FOUR = wp.types.matrix(shape=(4, 3), dtype=wp.float32)
"""Positions of the four ends of two edges, row by row"""


@wp.struct
class Crossing:
    """Closest points of two edges."""

    parts: wp.vec2  # of the way along each
    first: wp.vec3  # edge, from its start to its end [m]
    second: wp.vec3
    normal: wp.vec3  # from the first to the second; zero where they are at one place
    gap: float  # [m]


@wp.func
def nearest_parts(start: wp.vec3, first: wp.vec3, second: wp.vec3):
    """Return the closest points of two edges as fractions of each edge (Ericson 2004, section 5.1.9).

    Args:
        start: Start of the first edge relative to the start of the second [m].
        first: Vector from the start of the first edge to its end [m].
        second: Vector from the start of the second edge to its end [m].
    """
    a = wp.max(wp.length_sq(first), LEAST)
    e = wp.max(wp.length_sq(second), LEAST)
    b = wp.dot(first, second)
    c = wp.dot(first, start)
    f = wp.dot(second, start)
    sine = a * e - b * b
    s = float(0.5)
    if sine > PARALLEL * a * e:
        s = wp.clamp((b * f - c * e) / sine, 0.0, 1.0)
    t = wp.clamp((b * s + f) / e, 0.0, 1.0)
    s = wp.clamp((b * t - c) / a, 0.0, 1.0)
    return wp.vec2(s, t)


@wp.func
def crossing_of(a: wp.vec3, b: wp.vec3, c: wp.vec3, d: wp.vec3):
    """Return the closest points of the edges from a to b and from c to d."""
    crossing = Crossing()
    crossing.first = b - a
    crossing.second = d - c
    crossing.parts = nearest_parts(a - c, crossing.first, crossing.second)
    arm = c + crossing.parts[1] * crossing.second - a - crossing.parts[0] * crossing.first
    crossing.gap = wp.length(arm)
    crossing.normal = wp.normalize(arm)
    return crossing


@wp.func
def weights_of(parts: wp.vec2):
    """Return the weights of the four ends in the second edge's velocity relative to the first."""
    return wp.vec4(parts[0] - 1.0, -parts[0], 1.0 - parts[1], parts[1])


@wp.func
def is_within(crossing: Crossing):
    """Return whether the closest points are inside both edges."""
    return wp.min(crossing.parts) > 0.0 and wp.max(crossing.parts) < 1.0


@wp.func
def crosses(crossing: Crossing):
    """Return whether friction acts: closest points are inside both edges, which are not nearly parallel."""
    least = CROSSED * wp.length(crossing.first) * wp.length(crossing.second)
    across_both = wp.dot(wp.cross(crossing.first, crossing.second), crossing.normal)  # of rounding where the gap is
    return is_within(crossing) and wp.abs(across_both) > least


@wp.func
def couples_of(crossing: Crossing):
    """Return the couples a and b of 1 N s of friction along each axis, as vectors: their dot products with the axis."""
    scale = crossing.gap / wp.dot(wp.cross(crossing.first, crossing.second), crossing.normal)
    first = scale * wp.cross(crossing.second, crossing.normal)
    return first, scale * wp.cross(crossing.normal, crossing.first)

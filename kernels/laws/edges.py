"""Edges that meet edges: rims of open sheets and sharp seams, between whose particles none of the other's may be.

With p and q the nearest points of two edges as a substep begins, n the unit vector from p to q and g their distance, an
impulse along n lets them come nearer by no more than is left of the distance d that they keep,

    n . (u_q - u_p) >= -max(g - d, 0) / h,

with u as all other forces would leave it. The ends of each edge get it by the weights of p or q, where they were: so
momentum and angular momentum stay, kinetic energy does not grow, no side has to be remembered, and none is crossed.

Friction is Coulomb's: an impulse J across n, against the slip, up to friction times that along n. It acts at q and,
opposite, at p. The torque of that, g n x J, is borne by couples along n at the ends of the edges e_1 and e_2: impulses
of -a and a, and of -b and b, with a e_1 + b e_2 = g J. Slip is measured with the same weights, so that friction gives
no energy.
"""

import warp as wp

from balloon_warp.kernels.laws.touch import LEAST, across

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
def ease_along(weights: wp.vec4, eases: wp.vec4):
    """Return the inverse effective mass of the two edges along their normal [1/kg]."""
    return wp.dot(wp.cw_mul(weights, weights), eases)


@wp.func
def push_apart(parting: float, gap: float, kept: float, ease: float, step_seconds: float):
    """Return the impulse along n that keeps two edges apart [N s].

    Args:
        parting: n . (u_q - u_p) [m/s].
        gap: g [m].
        kept: d [m].
    """
    least = -wp.max(gap - kept, 0.0) / step_seconds
    return wp.max(least - parting, 0.0) / wp.max(ease, LEAST)


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
def couples(crossing: Crossing, along: wp.vec3):
    """Return the couples a and b of 1 N s of friction along a unit vector across n."""
    scale = crossing.gap / wp.dot(wp.cross(crossing.first, crossing.second), crossing.normal)
    return wp.vec2(
        scale * wp.dot(wp.cross(along, crossing.second), crossing.normal),
        scale * wp.dot(wp.cross(crossing.first, along), crossing.normal),
    )


@wp.func
def sliding_at(crossing: Crossing, weights: wp.vec4, moving: FOUR):
    """Return the sliding velocity of the second edge along the first at their closest points [m/s].

    Args:
        moving: Velocities of the four ends [m/s].
    """
    scale = crossing.gap / wp.dot(wp.cross(crossing.first, crossing.second), crossing.normal)
    rise = scale * wp.dot(moving[1] - moving[0], crossing.normal)
    other_rise = scale * wp.dot(moving[3] - moving[2], crossing.normal)
    slide = across(weights * moving, crossing.normal)
    slide += rise * wp.cross(crossing.second, crossing.normal)
    return slide + other_rise * wp.cross(crossing.normal, crossing.first)


@wp.func
def rub_shares(crossing: Crossing, weights: wp.vec4, along: wp.vec3):
    """Share of each end in 1 N s of friction along a unit vector."""
    couple = couples(crossing, along)
    return wp.matrix_from_rows(
        weights[0] * along - couple[0] * crossing.normal,
        weights[1] * along + couple[0] * crossing.normal,
        weights[2] * along - couple[1] * crossing.normal,
        weights[3] * along + couple[1] * crossing.normal,
    )


@wp.func
def friction_of_edges(speed: float, shares: FOUR, eases: wp.vec4, most: float):
    """Return the friction impulse at a sliding speed [N s], no more than `most`."""
    ease = float(0.0)
    for end in range(4):
        ease += eases[end] * wp.length_sq(shares[end])
    return wp.min(speed / wp.max(ease, LEAST), most)

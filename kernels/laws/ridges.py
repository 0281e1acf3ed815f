"""Edges that meet edges, and ridges of solids against faces and edges.

Edges that meet edges: rims of open sheets and sharp seams, between whose particles none of the other's may be.

With p and q the nearest points of two edges as a substep begins, and n the unit vector from p to q, the ends of each
edge bear the contact by the weights of p or q, where they were, see `contact.contact`.

Friction is an impulse J across n at q and, opposite, at p. The torque of that, g n x J, is borne by couples along n at
the ends of the edges e_1 and e_2: impulses of -a and a, and of -b and b, with a e_1 + b e_2 = g J. Slip is measured
with the same weights, so that friction gives no energy.

Ridges of solids against faces and edges of balloons, between whose particles they could go.

Ridges are convex edges, the axes of capsules, and the centers of spheres.

With q the point of a ridge and p the point of a balloon's face or edge that are nearest as a substep begins, n is the
unit vector from q to p and g their distance, less the ridge's radius. The corners bear the contact by the weights of p,
see `contact.contact`.

Which side of a ridge is outside is told by the solid's sides beside it: n may not lead far above one of them. A
particle there that slides to the ridge is left to contact of particles; one a little above it may come down beside it
within a step.
"""

import warp as wp

from balloon_warp.kernels.laws.touch import LEAST, nearest_weights

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


ABOVE = wp.constant(0.6)
"""Cosine between n and a side of the solid above which a balloon counts as on that side"""
LITTLE_GAP = wp.constant(0.5)
"""Fraction of the minimum distance below which features are moved apart"""
PARTED = wp.constant(0.2)
"""Fraction of the missing distance that is restored in a step"""
AT_END = wp.constant(1.0e-4)
"""Fraction of an edge's length that counts as its end"""


@wp.struct
class Ridge:
    """A thick line of a solid, as seen from that."""

    begin: wp.vec3
    end: wp.vec3
    inward: wp.vec3  # from the ridge along one side of the solid, a unit vector; zero if there is none
    other_inward: wp.vec3
    radius: float  # around the line [m]
    tips: wp.int32  # whether its begin (1) and its end (2) are its own: each corner is one ridge's


@wp.struct
class Near:
    """Closest points of a balloon's feature and a ridge, relative to the solid."""

    weights: wp.vec3  # of the feature's corners
    normal: wp.vec3  # from the ridge, zero where they do not meet
    gap: float  # [m]


@wp.func
def is_outside(ridge: Ridge, normal: wp.vec3):
    """Return whether a direction leaves the solid beside a ridge, above none of its sides."""
    return wp.dot(normal, ridge.inward) <= ABOVE and wp.dot(normal, ridge.other_inward) <= ABOVE


@wp.func
def near_of(ridge: Ridge, arm: wp.vec3, weights: wp.vec3):
    """Return the contact of the shortest arm from a ridge to a balloon."""
    near = Near()
    near.gap = wp.length(arm) - ridge.radius
    near.weights = weights
    normal = wp.normalize(arm)
    if is_outside(ridge, normal):
        near.normal = normal
    return near


@wp.func
def edge_near(ridge: Ridge, a: wp.vec3, b: wp.vec3):
    """Return the closest points of an edge between two particles and a ridge.

    Particles at the edge's ends meet the solid themselves.
    """
    crossing = crossing_of(ridge.begin, ridge.end, a, b)
    part = crossing.parts[1]
    arm = crossing.gap * crossing.normal
    near = near_of(ridge, arm, wp.vec3(1.0 - part, part, 0.0))
    at_tip = wp.min(crossing.parts[0], 1.0 - crossing.parts[0]) <= 0.0
    if at_tip or wp.min(part, 1.0 - part) < AT_END:
        near.normal = wp.vec3()
    return near


@wp.func
def tip_near(ridge: Ridge, tip: wp.vec3, away: wp.vec3, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return the closest points of a face and a tip of a ridge.

    Args:
        away: Vector from the tip along the ridge.
    """
    weights = nearest_weights(tip, a, b, c)
    arm = weights[0] * a + weights[1] * b + weights[2] * c - tip
    near = near_of(ridge, arm, weights)
    if wp.dot(near.normal, away) > ABOVE * wp.length(away) or wp.max(weights) > 1.0 - AT_END:
        near.normal = wp.vec3()
    return near


@wp.func
def nearer(first: Near, second: Near):
    """Return the one of two that is nearer; one that does not meet is far."""
    if wp.length_sq(second.normal) > 0.0 and (wp.length_sq(first.normal) == 0.0 or second.gap < first.gap):
        return second
    return first


@wp.func
def face_near(ridge: Ridge, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return the closest points of a face and those tips of a ridge that belong to it."""
    near = Near()
    if (ridge.tips & 1) != 0:
        near = tip_near(ridge, ridge.begin, ridge.end - ridge.begin, a, b, c)
    if (ridge.tips & 2) != 0:
        near = nearer(near, tip_near(ridge, ridge.end, ridge.begin - ridge.end, a, b, c))
    return near


@wp.func
def way_to_part(gap: float, kept: float):
    """Return the displacement that restores the distance in a step where little of it is left [m], without speed."""
    return PARTED * wp.max(LITTLE_GAP * kept - gap, 0.0)

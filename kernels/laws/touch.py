"""Contact of balloons: particles and spheres against triangles, edges against edges, and ridges of solids.

A particle meets a triangle of another surface, or of its own, across a thin skin. With y the point of the triangle that
is nearest to the particle x, n the unit vector from y to x, turned outward where x is behind, and g = n . (x - y) the
gap, the particle overlaps by o = thickness - g. It is pushed along n by

    F = k o + c (approach speed)    but never pulled

the same from outside and from behind: a particle is pushed out where it came in. Its energy is k o^2 / 2, no more than
came in with it: the damping, c = 2 z root(k m) of the reduced mass m, acts against the motion, and where the sum would
pull it is left out. The triangle's corners get the opposite force by the barycentric weights of y, so that both forces
are on one line, and neither momentum nor angular momentum changes.

Friction is Coulomb's, with one coefficient, by a spring along the surface (Cundall and Strack 1979): from where x took
hold of the triangle, it stretches as they slide and pulls back as stiff as the contact, up to friction times F; from
there on it slips. It acts at x, and on the triangle as if that reached rigidly to x: the weights w_i of the corners'
forces have a part along n more,

    F_i = -w_i F + g (G_i . F) n,    G_i the gradient of w_i across n,

whose torque is that of the arm g n. Slip is measured with the same weights, so that friction only dissipates energy.

Contact of a sphere with a triangle of a balloon in a step: the time of impact, and the impulse. With y the triangle's
point nearest to the center c, of the corners' weights w_i, and n the unit vector from y to c, an impulse along n stops
the approach,

    n . (V' - sum w_i v_i') >= 0,

the sphere's and, by their weights, the corners'. It acts where |c - y| comes down to the radius, on straight ways, and
all go on from there at their new velocities: so momentum stays, and angular momentum, since n passes through both; and
kinetic energy does not grow. Springs and gas make it rebound.

Friction acts in the same moment, at the same point, see `laws.contact`. When they come so near is found in steps over
which they cannot (conservative advancement: the distance falls by no more than the center's way beside the corners').
The nearest point is on the side where the center is, and the center never comes to the surface: so none changes sides,
from outside or from within, at any speed, however small it is.

Edges that meet edges: rims of open sheets and sharp seams, between whose particles none of the other's may be. With p
and q the nearest points of two edges as a substep begins, and n the unit vector from p to q, the ends of each edge bear
the contact by the weights of p or q, where they were, see `contact.contact`.

Friction is an impulse J across n at q and, opposite, at p. The torque of that, g n x J, is borne by couples along n at
the ends of the edges e_1 and e_2: impulses of -a and a, and of -b and b, with a e_1 + b e_2 = g J. Slip is measured
with the same weights, so that friction gives no energy.

Ridges of solids meet faces and edges of balloons, between whose particles they could go. Ridges are convex edges, the
axes of capsules, and the centers of spheres. With q the point of a ridge and p the point of a balloon's face or edge
that are nearest as a substep begins, n is the unit vector from q to p and g their distance, less the ridge's radius.
The corners bear the contact by the weights of p, see `contact.contact`.

Which side of a ridge is outside is told by the solid's sides beside it: n may not lead far above one of them. A
particle there that slides to the ridge is left to contact of particles; one a little above it may come down beside it
within a step.
"""

import warp as wp

from balloon_warp.kernels.laws.contact import NEVER, friction_impulse, inverse_mass_of_ball, separation
from balloon_warp.kernels.laws.law import Parameter

FROM_THE_MESH = -1.0
"""Marker: thickness or stiffness that follows from the mesh"""
TOUCH = (
    Parameter(
        "touch_friction",
        "1",
        0.3,
        least=0.0,
        of="world",
        path="touch.friction",
        meaning="Coulomb friction coefficient between balloons that have none of their own",
    ),
    Parameter(
        "touch_thickness",
        "m",
        FROM_THE_MESH,
        least=0.0,
        of="world",
        path="touch.thickness",
        meaning="Distance at which surfaces begin to push; a twentieth of their meshes' edges when missing",
    ),
    Parameter(
        "touch_stiffness",
        "N/m",
        FROM_THE_MESH,
        least=0.0,
        of="world",
        path="touch.stiffness",
        meaning="Contact stiffness of each particle; a quarter of the sum of a particle's springs when missing",
    ),
)
DAMPING_RATIO = wp.constant(0.2)
"""Damping ratio z, relative to critical damping: a particle that meets a wall leaves it with about half of its speed"""
LEAST = wp.constant(1.0e-30)
"""Least divisor"""
FLAT = wp.constant(1.0e-6)
"""Square of the sine between two edges below which corners are on a line, as far as rounding tells"""
NEAR = wp.constant(1.0e-3)
"""Distance to a triangle's edge that counts as on the edge, over the triangle's size"""
STEEPEST = wp.constant(0.3)
"""Cosine between n and a triangle's normal below which there is no friction beside an edge, since its arm would need
excessively large forces"""


@wp.func
def quotient(part: float, whole: float):
    """Return part / whole, or 0 where the whole is zero or less, as on an edge without length."""
    return wp.where(whole > LEAST, part / wp.max(whole, LEAST), 0.0)


@wp.func
def along_line(d1: float, d2: float, d3: float, d4: float, d5: float, d6: float):
    """Return the weights of the nearest point where all corners are on a line: on any edge that the point is beside.

    Rounding alone says then on which side of an edge it is, so that `nearest_weights` may find no edge.
    """
    if d1 >= 0.0 and d3 <= 0.0 and d1 > d3:
        part = quotient(d1, d1 - d3)
        return wp.vec3(1.0 - part, part, 0.0)
    if d2 >= 0.0 and d6 <= 0.0:
        part = quotient(d2, d2 - d6)
        return wp.vec3(1.0 - part, 0.0, part)
    part = quotient(d4 - d3, (d4 - d3) + (d5 - d6))
    return wp.vec3(0.0, 1.0 - part, part)


@wp.func
def nearest_weights(point: wp.vec3, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return the barycentric weights of a triangle's point that is nearest to another (Ericson 2004, section 5.1.5)."""
    ab = b - a
    ac = c - a
    d1 = wp.dot(ab, point - a)
    d2 = wp.dot(ac, point - a)
    if d1 <= 0.0 and d2 <= 0.0:
        return wp.vec3(1.0, 0.0, 0.0)
    d3 = wp.dot(ab, point - b)
    d4 = wp.dot(ac, point - b)
    if d3 >= 0.0 and d4 <= d3:
        return wp.vec3(0.0, 1.0, 0.0)
    beside_c = d1 * d4 - d3 * d2
    if beside_c <= 0.0 and d1 >= 0.0 and d3 <= 0.0 and d1 > d3:  # equal where a and b are at one place
        part = quotient(d1, d1 - d3)
        return wp.vec3(1.0 - part, part, 0.0)
    d5 = wp.dot(ab, point - c)
    d6 = wp.dot(ac, point - c)
    if d6 >= 0.0 and d5 <= d6:
        return wp.vec3(0.0, 0.0, 1.0)
    beside_b = d5 * d2 - d1 * d6
    if beside_b <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        part = quotient(d2, d2 - d6)
        return wp.vec3(1.0 - part, 0.0, part)
    beside_a = d3 * d6 - d5 * d4
    if beside_a <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        part = quotient(d4 - d3, (d4 - d3) + (d5 - d6))
        return wp.vec3(0.0, 1.0 - part, part)
    whole = beside_a + beside_b + beside_c
    if whole <= FLAT * wp.dot(ab, ab) * wp.dot(ac, ac):
        return along_line(d1, d2, d3, d4, d5, d6)
    v = quotient(beside_b, whole)
    w = quotient(beside_c, whole)
    return wp.vec3(1.0 - v - w, v, w)


@wp.func
def weighted(weights: wp.vec3, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return the mean of the corners' vectors by their weights."""
    return weights[0] * a + weights[1] * b + weights[2] * c


@wp.func
def facing(arm: wp.vec3, weights: wp.vec3, area_vector: wp.vec3):
    """Return the unit vector n of the arm from the nearest point to the particle, outward; zero if there is none.

    Inside the triangle it is the normal, and so it is so near to an edge or a corner that the arm's direction is
    rounding.
    """
    distance = wp.length(arm)
    if wp.min(weights) > 0.0 or distance * distance <= NEAR * NEAR * wp.length(area_vector):
        return wp.normalize(area_vector)
    return arm * (wp.where(wp.dot(arm, area_vector) < 0.0, -1.0, 1.0) / wp.max(distance, LEAST))


@wp.func
def share_of_contact(crowd: float):
    """Return the factor on a contact's stiffness and damping where more meet than the step allows for.

    Args:
        crowd: Number of contacts of its busiest particle, over the number that the step allows for.
    """
    return 1.0 / wp.max(crowd, 1.0)


@wp.func
def touch_damping(stiffness: float, mass: float):
    """Return the damping c [N s/m] of a contact with a reduced mass [kg]."""
    return 2.0 * DAMPING_RATIO * wp.sqrt(stiffness * mass)


@wp.func
def touch_push(overlap: float, approach: float, stiffness: float, mass: float):
    """Push F of a contact [N].

    Args:
        overlap: o [m].
        approach: how fast it grows [m/s].
        mass: reduced, of the particle and the point that it meets [kg].
    """
    return wp.max(stiffness * overlap + touch_damping(stiffness, mass) * approach, 0.0)


@wp.func
def across(vector: wp.vec3, normal: wp.vec3):
    """Return the tangential part of a vector."""
    return vector - wp.dot(vector, normal) * normal


@wp.func
def touch_friction(slip: wp.vec3, slide: wp.vec3, most: float, stiffness: float, mass: float):
    """Return the friction on the particle [N], no more than `most`, and the remaining slip [m].

    Args:
        slip: across n, from where the particle took hold [m].
        slide: how fast it grows [m/s].
    """
    pull = -(stiffness * slip + touch_damping(stiffness, mass) * slide)
    pull *= wp.min(quotient(most, wp.length(pull)), 1.0)
    slip *= wp.min(quotient(most, stiffness * wp.length(slip)), 1.0)
    return pull, slip


@wp.func
def reach_gradient(normal: wp.vec3, edge: wp.vec3, area_vector: wp.vec3):
    """Return G of a corner [1/m], from the edge opposite, counter-clockwise; nothing where the triangle is too steep.

    Args:
        area_vector: twice the triangle's area along its normal.
    """
    along = wp.dot(normal, area_vector)
    if along <= STEEPEST * wp.length(area_vector):
        return wp.vec3()
    return wp.cross(normal, edge) / wp.max(along, LEAST)


MAX_ADVANCEMENTS = wp.constant(256)
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
    displacement: wp.vec3
    starts: wp.mat33  # of the corners, row by row
    displacements: wp.mat33
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
    facing.displacement = end - start
    facing.starts = starts
    facing.displacements = ends - starts
    size = wp.length(starts[1] - starts[0]) + wp.length(starts[2] - starts[0])
    facing.radius = wp.max(radius, LEAST_RADIUS * size)
    facing.own_radius = radius
    return facing


@wp.func
def seen_at(facing: Facing, part: float):
    """Return the closest point's weights and the arm from it to the center, after a fraction of the step."""
    corners = facing.starts + part * facing.displacements
    center = facing.start + part * facing.displacement
    weights = nearest_weights(center, corners[0], corners[1], corners[2])
    return weights, center - weighted(weights, corners[0], corners[1], corners[2])


@wp.func
def displacement_beside(facing: Facing, weights: wp.vec3):
    """Return the center's displacement relative to the triangle's point of these weights."""
    return facing.displacement - weighted(
        weights, facing.displacements[0], facing.displacements[1], facing.displacements[2]
    )


@wp.func
def longest_displacement(facing: Facing):
    """Return the longest way of the center beside a corner."""
    first = wp.length(facing.displacement - facing.displacements[0])
    return wp.max(
        wp.max(first, wp.length(facing.displacement - facing.displacements[1])),
        wp.length(facing.displacement - facing.displacements[2]),
    )


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
    longest = longest_displacement(facing)
    little = LITTLE * facing.radius + ROUNDING * wp.length(facing.start)
    part = float(0.0)
    found = float(NEVER)
    iterations = wp.int32(0)
    while part <= 1.0 and found > 1.0:
        weights, arm = seen_at(facing, part)
        distance = wp.length(arm)
        nearer = -(1.0 - part) * wp.dot(displacement_beside(facing, weights), arm)
        if distance < radius and nearer > little * distance:
            found = part
        iterations += 1
        if iterations >= MAX_ADVANCEMENTS:
            found = part
        part = part_after(part, distance, radius, longest)
    return found, iterations


@wp.func
def impact(
    facing: Facing,
    part: float,
    velocity: wp.vec3,
    velocities: wp.mat33,
    inverse_masses: wp.vec4,
    spin: wp.vec3,
    friction: float,
    step_seconds: float,
):
    """Find the impact of a contact after a part of the step.

    Args:
        velocity: of the sphere.
        velocities: of the corners, row by row.
        inverse_masses: 1 over the masses of sphere and corners, 0 of one that is fixed [1/kg].
        spin: of the sphere [rad/s].
        friction: of both.
    """
    weights, arm = seen_at(facing, part)
    normal = wp.normalize(arm)
    nearest = wp.min(wp.length(arm), facing.radius)
    end = facing.start + facing.displacement
    end -= weighted(
        weights,
        facing.starts[0] + facing.displacements[0],
        facing.starts[1] + facing.displacements[1],
        facing.starts[2] + facing.displacements[2],
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
        out = wp.max(separation(gap, step_seconds), (KEPT * nearest - (1.0 - FREE) * facing.radius) - gap)
        shift += out
    pulled = wp.vec4(
        inverse_masses[0],
        -weights[0] * inverse_masses[1],
        -weights[1] * inverse_masses[2],
        -weights[2] * inverse_masses[3],
    )
    whole = pulled[0] - wp.dot(weights, wp.vec3(pulled[1], pulled[2], pulled[3]))
    met = Impact()
    met.normal = normal
    met.shifts = (shift / whole) * pulled
    met.gains = (gain / whole) * pulled
    met.pulled = pulled
    met.arm = -bent
    met.seconds = rest_of_step
    inverse_mass = whole - inverse_masses[0] + inverse_mass_of_ball(1.0 / inverse_masses[0], facing.own_radius, bent)
    sliding = beside + gain * normal + wp.cross(spin, met.arm)
    met.rub = friction_impulse(sliding, normal, inverse_mass, friction * gain / whole)
    return met


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
def separating_shift(gap: float, kept: float):
    """Return the displacement that restores the distance in a step where little of it is left [m], without speed."""
    return PARTED * wp.max(LITTLE_GAP * kept - gap, 0.0)

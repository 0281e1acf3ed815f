"""Contact of balloons: a particle against a triangle of another surface, or of its own, across a thin skin.

With y the point of the triangle that is nearest to the particle x, n the unit vector from y to x, turned outward where
x is behind, and g = n . (x - y) the gap, the particle overlaps by o = thickness - g. It is pushed along n by

    F = k o + c (approach speed)    but never pulled

the same from outside and from behind: a particle is pushed out where it came in. Its energy is k o^2 / 2, no
more than came in with it: the damping, c = 2 z root(k m) of the reduced mass m, acts against the motion, and where
the sum would pull it is left out. The triangle's corners get the opposite force by the barycentric weights of y, so
that both forces are on one line, and neither momentum nor angular momentum changes.

Friction is Coulomb's, with one coefficient, by a spring along the surface (Cundall and Strack 1979): from where x took
hold of the triangle, it stretches as they slide and pulls back as stiff as the contact, up to friction times F; from
there on it slips. It acts at x, and on the triangle as if that reached rigidly to x: the weights w_i of the corners'
forces have a part along n more,

    F_i = -w_i F + g (G_i . F) n,    G_i the gradient of w_i across n,

whose torque is that of the arm g n. Slip is measured with the same weights, so that friction only dissipates energy.
"""

import warp as wp

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

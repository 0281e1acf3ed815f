"""Tension field of wrinkling membranes, see `laws.membrane`, and the viscosity of their material.

The metric M of a triangle holds the dot products of its edges; at rest its inverse is G. Stresses are second
Piola-Kirchhoff stresses along the edges: none needs a local frame of the triangle.
"""

import warp as wp

NEVER_ZERO = wp.constant(1.0e-12)
"""Least divisor, below all squared stretches that count"""
LEAST_DET = wp.constant(0.01)
"""Least determinant where nothing wrinkles: a triangle squeezed further resists as there"""


@wp.func
def mixed_stretch(metric: wp.vec3, rest: wp.vec4):
    """Return G M, row by row: its trace, determinant and eigenvalues are those of C.

    Args:
        metric: of M, the products d1 . d1, d1 . d2 and d2 . d2 of a triangle's edges.
        rest: of G, the inverse of M at rest, its components 11, 12 and 22.
    """
    return wp.vec4(
        rest[0] * metric[0] + rest[1] * metric[1],
        rest[0] * metric[1] + rest[1] * metric[2],
        rest[1] * metric[0] + rest[2] * metric[1],
        rest[1] * metric[1] + rest[2] * metric[2],
    )


@wp.func
def invariants_of(mixed: wp.vec4):
    """Trace, determinant, and by how much the larger squared stretch a exceeds the smaller b, of G M."""
    apart = mixed[0] - mixed[3]
    across = mixed[1] * mixed[2]
    return (
        mixed[0] + mixed[3],
        mixed[0] * mixed[3] - across,
        wp.sqrt(wp.max(apart * apart + 4.0 * across, 0.0)),
    )


@wp.func
def squared_size(rest: wp.vec4):
    """Return det G [1/m^4]."""
    return rest[0] * rest[2] - rest[1] * rest[1]


@wp.func
def trace_and_det(metric: wp.vec3, rest: wp.vec4):
    """Return trace and determinant of G M, without its eigenvalues, which take longer."""
    trace = rest[0] * metric[0] + 2.0 * rest[1] * metric[1] + rest[2] * metric[2]
    return trace, squared_size(rest) * (metric[0] * metric[2] - metric[1] * metric[1])


@wp.func
def products_at_angles(metric: wp.vec3):
    """Return the dot products of the two edges at the angles opposite the first, the second and the third edge [m^2].

    Each is the cotangent of its angle times twice the triangle's area.
    """
    return wp.vec3(metric[2] - metric[1], metric[0] - metric[1], metric[1])


@wp.func
def is_taut(det: float, stretch: float, wrinkling: float):
    """Return whether there is tension both ways, b >= 1 / sqrt(a), that is a b >= sqrt(a), or no wrinkling.

    Args:
        stretch: sqrt(a), at least 1.
    """
    return det >= stretch or wrinkling == 0.0


@wp.func
def tautness(trace: float, det: float):
    """Return a number that is positive where there is tension both ways: (a b)^2 > a + b, which needs no root."""
    return det * det - trace


@wp.func
def how_surely_taut(metric: wp.vec3, rest: wp.vec4):
    """See `tautness`. A triangle of no size at rest has 0."""
    trace, det = trace_and_det(metric, rest)
    return tautness(trace, det)


@wp.func
def relaxed(by_trace: float, by_det: float, major: float, spread: float, across: float, taut: bool, wrinkling: float):
    """Return the slopes of the relaxed energy by trace and determinant [Pa], from those of the law.

    In wrinkles the energy is a function of the larger squared stretch a alone, whose slopes are a / (a - b) by the
    trace and -1 / (a - b) by the determinant.

    Args:
        by_trace: the law's slope at the state itself, or in wrinkles at (a, 1 / sqrt(a)).
        spread: a - b.
        across: 1 / sqrt(a), or 1 if that is more.
    """
    slope = (by_trace + by_det * across) / wp.max(spread, NEVER_ZERO)
    slack = wrinkling != 0.0 and major <= 1.0
    first = wp.where(taut, by_trace, slope * major)
    second = wp.where(taut, by_det, -slope)
    return wp.where(slack, 0.0, first), wp.where(slack, 0.0, second)


@wp.func
def compliance_of(rest: wp.vec4, metric: wp.vec3):
    """Return det G times the adjugate of M, which is det C times the inverse of M: components 11, 12 and 22."""
    return squared_size(rest) * wp.vec3(metric[2], -metric[1], metric[0])


@wp.func
def viscous_tension(
    mixed: wp.vec4,
    rate: wp.vec3,
    rest: wp.vec4,
    inverse: wp.vec3,
    major: float,
    spread: float,
    taut: bool,
    wrinkling: float,
    viscosity: float,
):
    """Return the viscous stress along the edges, which is added to the elastic one (Kelvin and Voigt) [Pa/m^2].

    It is that of an incompressible Newtonian fluid in the same place. Cauchy's is 2 eta (d + tr d 1), and 3 eta along
    the tension in wrinkles.

    Args:
        mixed: see `mixed_stretch`.
        rate: of the change of M [m^2/s].
        inverse: of M.
    """
    double_trace = inverse[0] * rate[0] + 2.0 * inverse[1] * rate[1] + inverse[2] * rate[2]
    left_11 = inverse[0] * rate[0] + inverse[1] * rate[1]
    left_12 = inverse[0] * rate[1] + inverse[1] * rate[2]
    left_21 = inverse[1] * rate[0] + inverse[2] * rate[1]
    left_22 = inverse[1] * rate[1] + inverse[2] * rate[2]
    both = wp.vec3(
        left_11 * inverse[0] + left_12 * inverse[1],
        left_11 * inverse[1] + left_12 * inverse[2],
        left_21 * inverse[1] + left_22 * inverse[2],
    )
    minor = major - spread
    along = wp.vec3(  # of the larger stretch: (G M - b) G / (a - b)
        (mixed[0] - minor) * rest[0] + mixed[1] * rest[1],
        (mixed[0] - minor) * rest[1] + mixed[1] * rest[2],
        mixed[2] * rest[1] + (mixed[3] - minor) * rest[2],
    ) / wp.max(spread, NEVER_ZERO)
    stretching = along[0] * rate[0] + 2.0 * along[1] * rate[1] + along[2] * rate[2]
    in_wrinkles = (1.5 * stretching / wp.max(major * major, 1.0)) * along
    slack = wrinkling != 0.0 and major <= 1.0
    stress = wp.where(taut, both + double_trace * inverse, in_wrinkles)
    return wp.where(slack, wp.vec3(), viscosity * stress)


@wp.func
def elastic_tension(metric: wp.vec3, rest: wp.vec4, by_trace: float, by_det: float, double_volume: float):
    """Return the elastic tensions along the edges, times the volume at rest, components 11, 12, 22 [N/m].

    The tensions are 2 (dW/dtr G + dW/ddet det C M^-1).

    Args:
        double_volume: twice that volume [m^3].
    """
    first = double_volume * by_trace
    second = double_volume * by_det * squared_size(rest)
    return wp.vec3(
        first * rest[0] + second * metric[2],
        first * rest[1] - second * metric[1],
        first * rest[2] + second * metric[0],
    )

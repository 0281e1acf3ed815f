"""What a membrane's law becomes where it wrinkles, see `laws.membrane`, and the damping of its material."""

from typing import Any

import warp as wp

NEVER_ZERO = wp.constant(1.0e-12)
"""below all squared stretches that count, so that it can be divided by"""
LEAST_DET = wp.constant(0.01)
"""of what does not wrinkle: squeezed further, a triangle resists as there"""


@wp.func
def invariants_of(c: wp.vec3):
    """Trace, determinant, and by how much the larger squared stretch a exceeds the smaller b, of C's components 11, 12
    and 22."""
    half = 0.5 * (c[0] - c[2])
    return c[0] + c[2], c[0] * c[2] - c[1] * c[1], 2.0 * wp.sqrt(half * half + c[1] * c[1])


@wp.func
def is_taut(det: float, stretch: float, wrinkling: float):
    """Whether there are tensions both ways, or what does not wrinkle: b >= 1 / sqrt(a) is a b >= sqrt(a).

    Args:
        stretch: sqrt(a), at least 1.
    """
    return det >= stretch or wrinkling == 0.0


@wp.func
def relaxed(by_trace: float, by_det: float, major: float, spread: float, across: float, taut: bool, wrinkling: float):
    """The energy's slopes by trace and determinant [Pa], of those of the law.

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
def viscous_stress(
    c: wp.vec3, rate: wp.vec3, det: float, major: float, spread: float, taut: bool, wrinkling: float, viscosity: float
):
    """The second Piola-Kirchhoff stress of an incompressible Newtonian fluid in the same place [Pa], which is added to
    the elastic one (Kelvin and Voigt): Cauchy's is 2 eta (d + tr d 1), and 3 eta along the tension in wrinkles.

    Args:
        c: components 11, 12 and 22 of C.
        rate: of their change [1/s].
    """
    inverse = wp.vec3(c[2], -c[1], c[0]) / wp.max(det, LEAST_DET)
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
    along = wp.vec3(c[0] - minor, c[1], c[2] - minor) / wp.max(spread, NEVER_ZERO)  # n n^T
    stretching = along[0] * rate[0] + 2.0 * along[1] * rate[1] + along[2] * rate[2]
    in_wrinkles = (1.5 * stretching / wp.max(major * major, 1.0)) * along
    slack = wrinkling != 0.0 and major <= 1.0
    stress = wp.where(taut, both + double_trace * inverse, in_wrinkles)
    return wp.where(slack, wp.vec3(), viscosity * stress)


@wp.func
def stress_of(c: wp.vec3, by_trace: float, by_det: float):
    """The second Piola-Kirchhoff stress 2 (dW/dtr 1 + dW/ddet adj C) [Pa], components 11, 12 and 22."""
    return wp.vec3(2.0 * (by_trace + by_det * c[2]), -2.0 * by_det * c[1], 2.0 * (by_trace + by_det * c[0]))


@wp.func
def pulled_back(metric: Any, rest: wp.vec4):
    """C, or its rate, of a triangle, from the products of its edges d1 and d2, or their rates.

    Args:
        metric: d1 . d1, d1 . d2 and d2 . d2.
        rest: a, b and c of the inverse [[a, b], [0, c]] of the edges at rest, in a frame along the first.
    """
    across = rest[1] * metric[0] + rest[2] * metric[1]
    return wp.vec3(
        rest[0] * rest[0] * metric[0],
        rest[0] * across,
        rest[1] * across + rest[2] * (rest[1] * metric[1] + rest[2] * metric[2]),
    )


@wp.func
def pushed_forward(stress: wp.vec3, rest: wp.vec4):
    """From a stress to its components along the edges: the reverse of `pulled_back`."""
    a = rest[0]
    b = rest[1]
    c = rest[2]
    return wp.vec3(
        a * (a * stress[0] + 2.0 * b * stress[1]) + b * b * stress[2],
        c * (a * stress[1] + b * stress[2]),
        c * c * stress[2],
    )

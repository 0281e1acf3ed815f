"""Membranes: rubber and film that is stretched in its plane, wrinkles, and softens.

Tension field of wrinkling membranes, see `laws.membrane`, and the viscosity of their material.

The metric M of a triangle holds the dot products of its edges; at rest its inverse is G. Stresses are second
Piola-Kirchhoff stresses along the edges: none needs a local frame of the triangle.

Membranes: rubber and film that is stretched in its plane. Incompressible, so that its thickness is 1 / det F.

C is the right Cauchy-Green tensor of the plane, a >= b its eigenvalues, the squared principal stretches; the third is
1 / (a b). A law is an energy W(a, b) for each volume at rest; it gives its slopes by the trace a + b and by the
determinant a b, from which the stress follows, S = 2 (dW/dtr 1 + dW/ddet adj C).

A thin skin does not resist compression: it wrinkles. Its energy is the least that is reached by wrinkles of any size
across the tension (Pipkin 1986, The relaxed energy density for isotropic elastic membranes):

    a <= 1                          slack: nothing
    b < 1 / sqrt(a)                 in wrinkles: W(a, 1 / sqrt(a)), whatever b
    otherwise                       taut: W(a, b)

The host calls the same functions with arrays, see `model.materials`.
"""

from collections.abc import Mapping

import warp as wp

from balloon_warp.kernels.algebra import power
from balloon_warp.kernels.laws.law import TINY, Law, Parameter

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


SHEAR_MODULUS = Parameter(
    "shear_modulus",
    "Pa",
    3.3e5,
    least=TINY,
    path="material.shear_modulus",
    meaning="Shear modulus at rest, a third of Young's modulus; 3.3e5 when missing",
)
THICKNESS = Parameter(
    "thickness", "m", 2.0e-4, least=1.0e-9, path="material.thickness", meaning="Thickness at rest; 2e-4 when missing"
)
WRINKLING = Parameter(
    "wrinkling", "1", 1.0, path="material.wrinkling", meaning="Wrinkling, 1, or else resistance to compression, 0"
)
MOST_STRETCH = Parameter(
    "most_stretch",
    "1",
    6.0,
    least=1.0,
    path="material.most_stretch",
    meaning='Largest equibiaxial stretch for which the step of "auto" is stable and "gent" holds; 6 when '
    'missing, or 0.96 of the locking stretch of "gent"',
)
FILM_VISCOSITY = Parameter(
    "film_viscosity",
    "Pa s",
    least=0.0,
    path="material.viscosity",
    meaning="Viscosity of the material, which damps any change of its shape",
)
MOONEY_RATIO = Parameter(
    "mooney_ratio",
    "1",
    0.1,
    least=0.0,
    path="material.mooney_ratio",
    meaning='Ratio C2 / C1 of "mooney_rivlin"; 0.1 when missing',
)
GENT_LIMIT = Parameter(
    "gent_limit",
    "1",
    97.2,
    least=TINY,
    path="material.gent_limit",
    meaning='Limit of I1 - 3 in "gent", where I1 is the sum of the three squared stretches; 97.2 when missing',
)
OGDEN_MODULI = Parameter(
    "ogden_moduli", "Pa", path="material.ogden_moduli", size=3, meaning='Moduli mu of the three terms of "ogden"'
)
OGDEN_EXPONENTS = Parameter(
    "ogden_exponents",
    "1",
    least=-20.0,  # powers of a stretch squeezed to `LEAST_DET` are float32's up to here
    most=20.0,
    path="material.ogden_exponents",
    size=3,
    meaning='Exponents alpha of the three terms of "ogden"',
)
OF_EVERY_MEMBRANE = (THICKNESS, WRINKLING, MOST_STRETCH, FILM_VISCOSITY)
"""Parameters of all membrane laws, needed wherever triangles are looped over"""
LEAST_ROOM = wp.constant(1.0e-3)
"""Least margin to the limit at a Gent material's largest stretch, over the limit; float32 resolves it to a
ten-thousandth"""
NEARLY_ALIKE = wp.constant(0.12)
"""Threshold of an Ogden material's series, over 6 and the square of half an exponent. Below it a series replaces the
quotient: its truncation error is 4e-7, and the quotient loses some 8e-7 from there on"""
OVER_6, OVER_20 = wp.constant(1.0 / 6.0), wp.constant(1.0 / 20.0)


@wp.func
def neo_hookean(det: float, shear_modulus: float):
    """Return the slopes of W = mu/2 (I1 - 3) by trace and determinant [Pa] (Treloar 1943); I1 = tr + 1/det."""
    half = 0.5 * shear_modulus
    return half, -half / (det * det)


@wp.func
def neo_hookean_energy(trace: float, det: float, shear_modulus: float):
    """Return the energy of a neo-Hookean film [J/m^3]."""
    return 0.5 * shear_modulus * (trace + 1.0 / det - 3.0)


@wp.func
def mooney_rivlin(trace: float, det: float, shear_modulus: float, mooney_ratio: float):
    """Return the slopes of W = C1 (I1 - 3) + C2 (I2 - 3) (Rivlin 1948).

    I2 = det + tr/det, and 2 (C1 + C2) is the shear modulus.
    """
    first = 0.5 * shear_modulus / (1.0 + mooney_ratio)
    second = mooney_ratio * first
    inverse = 1.0 / det
    return first + second * inverse, second - (first + second * trace) * inverse * inverse


@wp.func
def mooney_rivlin_energy(trace: float, det: float, shear_modulus: float, mooney_ratio: float):
    """Return the energy of Mooney and Rivlin's film [J/m^3]."""
    first = 0.5 * shear_modulus / (1.0 + mooney_ratio)
    return first * (trace + 1.0 / det - 3.0 + mooney_ratio * (det + trace / det - 3.0))


@wp.func
def locking_room(gent_limit: float, most_stretch: float):
    """Return the margin to a Gent material's limit at its largest equibiaxial stretch, and I1 there."""
    squared = most_stretch * most_stretch
    least = wp.max(gent_limit + 3.0 - 2.0 * squared - 1.0 / (squared * squared), LEAST_ROOM * gent_limit)
    return least, gent_limit + 3.0 - least


@wp.func
def gent(trace: float, det: float, shear_modulus: float, gent_limit: float, most_stretch: float):
    """Return the slopes of W = -mu J/2 ln(1 - (I1 - 3) / J) (Gent 1996), clamped at the I1 of the largest stretch.

    From there on, in place of a pole that no step could follow, a tension rises on with the root of I1, as it begins to
    there:

        dW/dI1 = mu J/2 / R (1 + (1 + 2 M / R) (s - 1)) / s,  s = sqrt(I1 / M),  R = J + 3 - M

    The energy's second derivative is then nowhere more than at M, so that no shorter step is needed.
    """
    least, most = locking_room(gent_limit, most_stretch)
    inverse = 1.0 / det
    first = trace + inverse
    s = wp.sqrt(wp.max(first / most, 1.0))
    left = wp.max(gent_limit + 3.0 - first, least)
    slope = 0.5 * shear_modulus * gent_limit * (1.0 + (1.0 + 2.0 * most / least) * (s - 1.0)) / (s * left)
    return slope, -slope * inverse * inverse


@wp.func
def gent_energy(trace: float, det: float, shear_modulus: float, gent_limit: float, most_stretch: float):
    """Return the energy of Gent's film [J/m^3]."""
    least, most = locking_room(gent_limit, most_stretch)
    first = trace + 1.0 / det
    s = wp.sqrt(wp.max(first / most, 1.0))
    rise = 1.0 + 2.0 * most / least
    beyond = (s - 1.0) * (1.0 - rise + 0.5 * rise * (s + 1.0)) * 2.0 * most / least
    left = wp.max(gent_limit + 3.0 - first, least)
    return 0.5 * shear_modulus * gent_limit * (beyond - wp.log(left / gent_limit))


@wp.func
def ogden(trace: float, det: float, spread: float, ogden_moduli: wp.vec3, ogden_exponents: wp.vec3):
    """Return the slopes of W = sum of mu/alpha (l1^alpha + l2^alpha + (l1 l2)^-alpha - 3) (Ogden 1972).

    l1 and l2 are the stretches.

    With k = alpha/2 the slope by the trace is the sum of mu/2 (a^k - b^k) / (a - b). Where both are nearly alike, a
    series takes the place of this quotient: with a = g e^t and b = g e^-t it is g^(k-1) sinh(k t) / sinh(t), and

        sinh(k t) / sinh(t) = k (1 + (k^2 - 1)/3! z + (k^2 - 1) (k^2 - 9)/5! z^2 + ...),  z = sinh(t)^2

    Args:
        spread: a - b = 2 g sinh(t).
    """
    inverse = 1.0 / det
    root = wp.sqrt(det)
    major = wp.max(0.5 * (trace + spread), root)  # a triangle squeezed to nothing still has a determinant
    z = 0.25 * spread * spread * inverse
    z_6 = z * OVER_6
    z_20 = z * OVER_20
    over_spread = 0.5 / wp.max(spread, NEVER_ZERO)
    over_root = 0.5 * root * inverse
    by_trace = float(0.0)
    by_growth = float(0.0)  # of both stretches alike: g dW/dg
    for term in range(3):
        k = 0.5 * ogden_exponents[term]
        q = k * k
        grown = power(det, 0.5 * k)  # g^k
        first = power(major, k)
        squared = grown * grown
        both = 1.0 / (first * squared)
        second = squared * squared * both
        series = 1.0 + (q - 1.0) * z_6 * (1.0 + (q - 9.0) * z_20)
        near = grown * k * over_root * series
        apart = (first - second) * over_spread
        by_trace = by_trace + ogden_moduli[term] * wp.where(q * z + 6.0 * z < NEARLY_ALIKE, near, apart)
        by_growth = by_growth + ogden_moduli[term] * (0.5 * (first + second) - first * both)
    return by_trace, 0.5 * (by_growth - by_trace * trace) * inverse


@wp.func
def ogden_energy(trace: float, det: float, spread: float, ogden_moduli: wp.vec3, ogden_exponents: wp.vec3):
    """Return the energy of Ogden's film [J/m^3]."""
    root = wp.sqrt(det)
    major = wp.max(0.5 * (trace + spread), root)
    energy = float(0.0)
    for term in range(3):
        k = 0.5 * ogden_exponents[term]
        if k != 0.0:  # or else the term is none
            grown = power(root, k)
            squared = grown * grown
            first = power(major, k)
            energy = energy + 0.5 * ogden_moduli[term] / k * (first + squared / first + 1.0 / squared - 3.0)
    return energy


MEMBRANES: Mapping[str, Law] = {
    law.name: law
    for law in (
        Law("membrane", neo_hookean, (SHEAR_MODULUS,), energy=neo_hookean_energy, linear=True),
        Law("membrane", mooney_rivlin, (SHEAR_MODULUS, MOONEY_RATIO), energy=mooney_rivlin_energy),
        Law("membrane", ogden, (OGDEN_MODULI, OGDEN_EXPONENTS), energy=ogden_energy),
        Law("membrane", gent, (SHEAR_MODULUS, GENT_LIMIT, MOST_STRETCH), energy=gent_energy),
    )
}
"""Membrane laws by their names in scenes; each balloon has one of them, or springs"""
PARAMETERS: tuple[Parameter, ...] = tuple(
    dict.fromkeys((*OF_EVERY_MEMBRANE, *(row for law in MEMBRANES.values() for row in law.parameters)))
)

"""Membranes: rubber and film that is stretched in its plane. Incompressible, so that its thickness is 1 / det F.

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

from balloon_warp.kernels.laws.law import TINY, Law, Parameter
from balloon_warp.kernels.powers import power

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
NEVER_ZERO = wp.constant(1.0e-12)
"""Least divisor, below all differences of squared stretches that count"""
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

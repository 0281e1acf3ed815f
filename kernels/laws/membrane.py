"""Membranes: rubber and film that is stretched in its plane. Incompressible, so that its thickness is 1 / det F.

C is the right Cauchy-Green tensor of the plane, a >= b its eigenvalues, the squared principal stretches; the third is
1 / (a b). A law is an energy W(a, b) for each volume at rest; what it gives are its slopes by the trace a + b and by
the determinant a b, from which the stress follows, S = 2 (dW/dtr 1 + dW/ddet adj C).

What is thin does not resist compression: it wrinkles. Its energy is the least that is reached by wrinkles of any size
across the tension (Pipkin 1986, The relaxed energy density for isotropic elastic membranes):

    a <= 1                          slack: nothing
    b < 1 / sqrt(a)                 in wrinkles: W(a, 1 / sqrt(a)), whatever b
    otherwise                       taut: W(a, b)

Laws are written with arithmetic alone, so that the host calls the same functions with arrays.
"""

from collections.abc import Mapping

import warp as wp

from balloon_warp.kernels.laws.law import TINY, Law, Parameter

SHEAR_MODULUS = Parameter(
    "shear_modulus",
    "Pa",
    3.3e5,
    least=TINY,
    path="material.shear_modulus",
    meaning="at rest; a third of Young's; 3.3e5 when missing",
)
THICKNESS = Parameter(
    "thickness", "m", 2.0e-4, least=1.0e-9, path="material.thickness", meaning="at rest; 2e-4 when missing"
)
WRINKLING = Parameter(
    "wrinkling", "1", 1.0, path="material.wrinkling", meaning="whether it wrinkles, or else resists compression"
)
MOST_STRETCH = Parameter(
    "most_stretch",
    "1",
    6.0,
    least=1.0,
    path="material.most_stretch",
    meaning='up to which the step of "auto" is stable, both ways; 6 when missing, or nine tenths of what "gent" allows',
)
FILM_VISCOSITY = Parameter(
    "film_viscosity", "Pa s", least=0.0, path="material.viscosity", meaning="of the material's own damping"
)
MOONEY_RATIO = Parameter(
    "mooney_ratio",
    "1",
    0.1,
    least=0.0,
    path="material.mooney_ratio",
    meaning='of "mooney_rivlin": C2 over C1; 0.1 when missing',
)
GENT_LIMIT = Parameter(
    "gent_limit",
    "1",
    97.2,
    least=TINY,
    path="material.gent_limit",
    meaning='of "gent": what I1 - 3 cannot exceed, I1 the sum of the three squared stretches; 97.2 when missing',
)
OGDEN_MODULI = Parameter(
    "ogden_moduli", "Pa", path="material.ogden_moduli", size=3, meaning='of "ogden": mu of each of three terms'
)
OGDEN_EXPONENTS = Parameter(
    "ogden_exponents", "1", path="material.ogden_exponents", size=3, meaning='of "ogden": alpha of each'
)
OF_EVERY_MEMBRANE = (THICKNESS, WRINKLING, MOST_STRETCH, FILM_VISCOSITY)
"""parameters that all laws have, and who goes around triangles asks for"""

LEAST_ROOM = wp.constant(0.02)
"""of the limit is left where a Gent material's chains count as locked: from there on it is stiff, but not infinitely"""
ROUND = wp.constant(3.0e-5)
"""is added to the squared sinh of an Ogden material's shear, so that it can be divided by; off by up to as much"""


@wp.func
def neo_hookean(det: float, shear_modulus: float):
    """W = mu/2 (I1 - 3), I1 = tr + 1/det: slopes by trace and determinant [Pa] (Treloar 1943)."""
    half = 0.5 * shear_modulus
    return half, -half / (det * det)


@wp.func
def neo_hookean_energy(trace: float, det: float, shear_modulus: float):
    """[J/m^3]"""
    return 0.5 * shear_modulus * (trace + 1.0 / det - 3.0)


@wp.func
def mooney_rivlin(trace: float, det: float, shear_modulus: float, mooney_ratio: float):
    """W = C1 (I1 - 3) + C2 (I2 - 3), I2 = det + tr/det, and 2 (C1 + C2) the shear modulus (Rivlin 1948)."""
    first = 0.5 * shear_modulus / (1.0 + mooney_ratio)
    second = mooney_ratio * first
    inverse = 1.0 / det
    return first + second * inverse, second - (first + second * trace) * inverse * inverse


@wp.func
def mooney_rivlin_energy(trace: float, det: float, shear_modulus: float, mooney_ratio: float):
    """[J/m^3]"""
    first = 0.5 * shear_modulus / (1.0 + mooney_ratio)
    return first * (trace + 1.0 / det - 3.0 + mooney_ratio * (det + trace / det - 3.0))


@wp.func
def gent(trace: float, det: float, shear_modulus: float, gent_limit: float, most_stretch: float):
    """W = -mu J/2 ln(1 - (I1 - 3) / J) (Gent 1996). Beyond the most stretch it goes on as a neo-Hookean material of the
    stiffness there."""
    squared = most_stretch * most_stretch
    least = 1.0 - (2.0 * squared + 1.0 / (squared * squared) - 3.0) / gent_limit
    least = 0.5 * (least + LEAST_ROOM + abs(least - LEAST_ROOM))  # the greater of both, of arrays, too
    room = 1.0 - (trace + 1.0 / det - 3.0) / gent_limit
    room = 0.5 * (room + least + abs(room - least))
    half = 0.5 * shear_modulus / room
    return half, -half / (det * det)


@wp.func
def gent_energy(trace: float, det: float, shear_modulus: float, gent_limit: float, most_stretch: float):
    """[J/m^3]"""
    squared = most_stretch * most_stretch
    least = wp.max(1.0 - (2.0 * squared + 1.0 / (squared * squared) - 3.0) / gent_limit, LEAST_ROOM)
    room = 1.0 - (trace + 1.0 / det - 3.0) / gent_limit
    beyond = wp.max(least - room, 0.0) / least
    return 0.5 * shear_modulus * gent_limit * (beyond - wp.log(wp.max(room, least)))


@wp.func
def ogden(trace: float, det: float, spread: float, ogden_moduli: wp.vec3, ogden_exponents: wp.vec3):
    """W = sum of mu/alpha (l1^alpha + l2^alpha + (l1 l2)^-alpha - 3) (Ogden 1972), l1 and l2 the stretches.

    With a = g e^t and b = g e^-t, each term is mu/alpha (2 g^k cosh(k t) + g^-alpha - 3), k = alpha/2: smooth where
    both stretches are alike, which quotients of differences would not be.

    Args:
        spread: a - b = 2 g sinh(t).
    """
    root = det**0.5
    sine = (0.25 * spread * spread / det + ROUND) ** 0.5
    cosine = (1.0 + sine * sine) ** 0.5
    by_trace = 0.0 * det
    by_root = 0.0 * det
    for term in range(3):
        k = 0.5 * ogden_exponents[term]
        grown = (cosine + sine) ** k
        powered = root**k
        shrunk = 1.0 / grown
        by_trace = by_trace + ogden_moduli[term] * powered * (grown - shrunk)
        by_root = by_root + ogden_moduli[term] * (0.5 * powered * (grown + shrunk) - 1.0 / (powered * powered))
    by_trace = by_trace / (4.0 * sine * root)
    return by_trace, (0.5 * by_root / root - by_trace * cosine) / root


@wp.func
def ogden_energy(trace: float, det: float, spread: float, ogden_moduli: wp.vec3, ogden_exponents: wp.vec3):
    """[J/m^3]"""
    first = 0.5 * (trace + spread)
    energy = 0.0 * det
    for term in range(3):
        k = 0.5 * ogden_exponents[term]
        if k != 0.0:  # or else the term is none
            energy = energy + 0.5 * ogden_moduli[term] / k * (first**k + (det / first) ** k + det ** (-k) - 3.0)
    return energy


MEMBRANES: Mapping[str, Law] = {
    law.name: law
    for law in (
        Law("membrane", neo_hookean, (SHEAR_MODULUS,), energy=neo_hookean_energy),
        Law("membrane", mooney_rivlin, (SHEAR_MODULUS, MOONEY_RATIO), energy=mooney_rivlin_energy),
        Law("membrane", ogden, (OGDEN_MODULI, OGDEN_EXPONENTS), energy=ogden_energy),
        Law("membrane", gent, (SHEAR_MODULUS, GENT_LIMIT, MOST_STRETCH), energy=gent_energy),
    )
}
"""by the names that scenes have for them; each balloon has one of them, or springs"""
PARAMETERS: tuple[Parameter, ...] = tuple(
    dict.fromkeys((*OF_EVERY_MEMBRANE, *(row for law in MEMBRANES.values() for row in law.parameters)))
)

"""Membranes: rubber and film that is stretched in its plane, wrinkles, softens, and tears.

The metric M of a triangle holds the dot products of its edges; at rest its inverse is G. Stresses are second
Piola-Kirchhoff stresses along the edges: none needs a local frame of the triangle.

A membrane is stretched in its plane, and incompressible, so that its thickness is 1 / det F. C is the right
Cauchy-Green tensor of the plane, a >= b its eigenvalues, the squared principal stretches; the third is 1 / (a b). A law
is an energy W(a, b) for each volume at rest; it gives its slopes by the trace a + b and by the determinant a b, from
which the stress follows, S = 2 (dW/dtr 1 + dW/ddet adj C).

A thin skin does not resist compression: it wrinkles. Its energy is the least that is reached by wrinkles of any size
across the tension, a tension field (Pipkin 1986, The relaxed energy density for isotropic elastic membranes):

    a <= 1                          slack: nothing
    b < 1 / sqrt(a)                 in wrinkles: W(a, 1 / sqrt(a)), whatever b
    otherwise                       taut: W(a, b)

The host calls the same functions with arrays, see `model.materials`.

Softening of rubber (Mullins 1948): once stretched, it pulls less until it is stretched further. A pseudo-elastic law
(Ogden and Roxburgh 1999, A pseudo-elastic model for the Mullins effect in filled rubber), with the third number that
Mars gave it: the stress is that of the law, times

    eta = 1 - s erf((P - W) / (m + b P))

W the energy density of the law [Pa], P the greatest that there has been. On first loading P = W and eta = 1; where P
stays, the stress is the slope of an energy that is less than W by the part lost for good. s is their 1 / r.

Rubber and film tear. A tear begins where the larger principal true stress reaches the `strength`, or where a needle
pierces. From face to face it runs on where the stress ahead of its tip exceeds the `tear_strength`, at most as fast as
waves on the surface of the unstretched material, 0.955 root(mu / rho) (Rayleigh's, of an incompressible solid). Below a
stress a balloon opens along one tear; above it tears branch, and it bursts to pieces (Moulinet and Adda-Bedia 2015,
Popping balloons: a case study of dynamical fragmentation, PRL 115, 184301).

A tear is straight: it runs where a plane cuts the unstretched skin, at first across the largest tension. Only faces
that the plane cuts, ahead of a tip, can tear. Faces beside a tear bear as much until a wave reaches them, but a notch
concentrates no stress there. So a tear is a gap one face wide on any mesh. A torn face does not pull.
"""

from collections.abc import Mapping
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import power
from balloon_warp.kernels.laws.law import FAR, TINY, Law, Parameter

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
    """Tautness margin, see `tautness`; 0 for a triangle of no size at rest."""
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
SOFTENING_PARAMETERS = (
    Parameter("softening", "1", least=0.0, most=0.95, path="material.softening"),
    Parameter("softening_energy", "Pa", 1.0e5, least=TINY, path="material.softening_energy"),
    Parameter("softening_share", "1", 0.3, least=0.0, most=10.0, path="material.softening_share"),
)
"""Parameters of the balloon; they have no columns among the laws', since few balloons have them"""


@wp.func
def softened(energy: float, peak: float, softening: float, softening_energy: float, softening_share: float):
    """Return the factor eta on the stress, from 1 - softening to 1.

    Args:
        energy: Energy density [Pa], at most the peak.
    """
    return 1.0 - softening * wp.erf((peak - energy) / (softening_energy + softening_share * peak))


def steepening(energy: Any, softening: Any, softening_energy: Any, softening_share: Any) -> Any:
    """Return the largest derivative of eta by the energy density below its peak [1/Pa].

    That is right at the peak. It makes rubber stiffer as it begins to give way. For the host.
    """
    root_of_pi = 1.7724539
    return 2.0 * softening / (root_of_pi * (softening_energy + softening_share * energy))


NEVER = 1.0e9
"""Time that is never reached [s]"""
RAYLEIGH = 0.955
"""Ratio of the speeds of Rayleigh waves and shear waves in an incompressible solid"""
TEARING, BRANCHING = 0.3, 0.5
"""Defaults, over the strength, of the stress ahead of a tear that it needs to advance, and of the stress above which it
branches"""
WHOLE = wp.constant(-1.0)
"""Marker: an intact face, in place of a tear's distance beyond it"""
TINY_LENGTH = wp.constant(1.0e-12)
"""Least length [m]"""
EVEN = wp.constant(0.05)
"""Difference of two squared stretches over their sum below which a tension has no direction"""
OPEN = wp.constant(0.25)
"""Area of a balloon's hole over its current surface area above which it no longer encloses gas"""
TEARING_PARAMETERS = (
    Parameter("film_strength", "Pa", FAR, least=TINY, path="material.strength"),
    Parameter("tear_strength", "Pa", float("nan"), least=TINY, path="material.tear_strength"),
    Parameter("branching_stress", "Pa", float("nan"), least=TINY, path="material.branching_stress"),
    Parameter("tear_speed", "m/s", float("nan"), least=TINY, path="material.tear_speed"),
    Parameter("needle_time", "s", NEVER, least=0.0, path="material.needle_time"),
)
"""Parameters of the balloon; NaN stands for a default that depends on other values"""


@wp.func
def true_stress(by_trace: float, by_det: float, major: float, minor: float):
    """Return the larger principal true stress l dW/dl [Pa], from slopes of the energy and squared stretches."""
    return 2.0 * major * (by_trace + by_det * minor)


@wp.func
def across_tension(first_rest: wp.vec3, second_rest: wp.vec3, first: wp.vec3, second: wp.vec3):
    """Return the direction of the larger stretch on the unstretched skin; that of the first edge where both are alike.

    Args:
        first_rest: two edges of a triangle, unstretched [m].
        first: the same now [m].
    """
    along = wp.normalize(first_rest)
    beside = second_rest - wp.dot(second_rest, along) * along
    first_slope = first / wp.length(first_rest)
    second_slope = (second - wp.dot(second_rest, along) * first_slope) / wp.max(wp.length(beside), TINY_LENGTH)
    larger = wp.length_sq(first_slope)
    other = wp.length_sq(second_slope)
    shear = 2.0 * wp.dot(first_slope, second_slope)
    direction = along
    if wp.length(wp.vec2(larger - other, shear)) > EVEN * (larger + other):
        angle = 0.5 * wp.atan2(shear, larger - other)
        direction = wp.cos(angle) * along + wp.sin(angle) * wp.normalize(beside)
    return direction


@wp.func
def plane_through(normal: wp.vec3, point: wp.vec3):
    """Return the plane through a point as its unit normal and its distance from the origin."""
    return wp.vec4(normal[0], normal[1], normal[2], wp.dot(normal, point))


@wp.func
def normal_of(plane: wp.vec4):
    """Read the unit normal of a plane."""
    return wp.vec3(plane[0], plane[1], plane[2])


@wp.func
def cuts(plane: wp.vec4, one: wp.vec3, other: wp.vec3):
    """Return whether a plane separates two points; a point on the plane counts as in front."""
    normal = normal_of(plane)
    return (wp.dot(normal, one) >= plane[3]) != (wp.dot(normal, other) >= plane[3])


@wp.func
def branch_plane(heading: wp.vec3, step: wp.vec3, face_normal: wp.vec3, point: wp.vec3):
    """Return the plane of a branch of a tear through a point, halfway between the tear's direction and a side.

    Args:
        heading: Unit vector along the other tear; zero where it begins.
        step: Direction to the side.
        face_normal: Normal of the skin there.
    """
    return plane_through(wp.normalize(wp.cross(face_normal, heading + wp.normalize(step))), point)

"""Springs, strings, torsion springs and position correction.

Position correction: after a step, springs longer than (1 + limit) times their rest length are shortened to that.

Both ends move alike, or the free one (Provot 1995). One spring after the other, of those that share no particle side by
side: springs are colored so that no two of a color meet, and a sweep takes the colors in turn (Gauss-Seidel), which
carries a correction through the balloon faster than averaging all springs' corrections (Jacobi). Colors go by where
particles stand at the start: neither the order of springs in memory nor the numbers of particles matter.

The velocities follow: an end that is moved by c in a step of h gains c / h. Then a velocity is that of the way which a
particle really went, where otherwise it would gather speed against the limit for as long as it is pulled. The gains of
the two ends are opposite, so that momentum stays; and along the spring, so that angular momentum stays to first order
in the step.

Torsion springs: across each edge, the angle between its two faces is kept instead of a length. A face is seen at the
mean of its corners beside the edge, which share the force there alike. The forces of a hinge come of an angle that no
movement of the whole changes, so that they have neither a sum nor a moment.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import inverse_root, squared_length
from balloon_warp.kernels.laws.law import Law, Parameter


@wp.func
def excess(d: wp.vec3, rest_length: float, limit: float):
    """Return the part of d, the vector along a spring, beyond the longest length allowed [m]; zero if shorter."""
    longest = (1.0 + limit) * rest_length
    squared = wp.length_sq(d)
    if squared <= longest * longest:
        return wp.vec3()
    return (1.0 - longest / wp.sqrt(squared)) * d


@wp.func
def share_of_correction(mass_share: float, mass_share_of_other: float):
    """Return one end's share of a correction: half, all beside a fixed end, or zero if it is fixed."""
    if mass_share == 0.0:
        return 0.0
    return wp.where(mass_share_of_other > 0.0, 0.5, 1.0)


@wp.func
def moves_of_ends(mass_share_p: float, mass_share_q: float, too_long: wp.vec3):
    """Return the displacements of a spring's two ends that remove an excess length [m]."""
    move_p = share_of_correction(mass_share_p, mass_share_q) * too_long
    move_q = -share_of_correction(mass_share_q, mass_share_p) * too_long
    return move_p, move_q


@wp.func
def hooke(squared_length: float, stiffness: float, stiffness_times_length: float):
    """Force per unit displacement [N/m] of a spring: k (|d| - L) d/|d| is (k - k L/|d|) d.

    Coincident ends have d = 0 and a finite coefficient: no force, no NaN.
    """
    return stiffness - stiffness_times_length * inverse_root(squared_length)


@wp.func
def hooke_energy(squared_length: float, rest_length: float, stiffness: float):
    """Return the energy of a spring, 1/2 k (|d| - L)^2 [J]."""
    strain = wp.sqrt(squared_length) - rest_length
    return 0.5 * stiffness * strain * strain


KINDS = (
    Parameter(
        "structural",
        "N/m",
        20.0,
        least=0.0,
        path="stiffness.structural",
        meaning="Spring constant k along the edges of faces",
    ),
    Parameter("shear", "N/m", 10.0, least=0.0, path="stiffness.shear", meaning="Spring constant k across faces"),
    Parameter(
        "flexion",
        "N/m",
        2.0,
        least=0.0,
        path="stiffness.flexion",
        meaning="Spring constant k past one particle, against bending",
    ),
)
"""Spring constants of the three kinds of springs (paper, figure 3), which the loops over springs look up"""
HOOKE = Law("spring", hooke, energy=hooke_energy, stiffness=lambda stiffness: stiffness)
NEVER_YIELDS = 1.0e9
"""Yield stretch of springs that do not yield: 1 - 1 / stretch is 1 in float32"""
NEVER_ZERO = wp.constant(1.0e-30)
"""Least divisor, below all that count"""


@wp.func
def rubber(
    squared_length: float,
    opening: float,
    stiffness: float,
    stiffness_times_length: float,
    viscosity: float,
    yield_stretch: float,
):
    """Return the addition to Hooke's coefficient [N/m]: t k (d . d') / |d|^2, t the viscosity.

    From the yield stretch on, it takes the whole pull away.
    """
    elastic = hooke(squared_length, stiffness, stiffness_times_length)
    if elastic > stiffness * (1.0 - 1.0 / yield_stretch):  # elastic / stiffness is 1 - L/|d|
        return -elastic
    return viscosity * stiffness * opening / squared_length


@wp.func
def rubber_at_limit(
    squared_length: float,
    opening: float,
    stiffness: float,
    stiffness_times_length: float,
    viscosity: float,
    yield_stretch: float,
    correction_limit: float,
):
    """Return the addition to Hooke's coefficient [N/m] that removes the force at the corrected length.

    A pull k L s at the strain s comes to its end smoothly at the limit c, as k L s (1 - (s / c)^2)^2, with slopes from
    -0.8 k to k. Many springs are at their limit, and rounding is not to decide which of them pull: where their force
    falls faster than Hooke's rises, a difference grows.
    """
    elastic = hooke(squared_length, stiffness, stiffness_times_length)
    plain = rubber(squared_length, opening, stiffness, stiffness_times_length, viscosity, yield_stretch)
    rest = stiffness - elastic  # k L / |d|
    used = wp.clamp(elastic / wp.max(correction_limit * rest, NEVER_ZERO), 0.0, 1.0)  # s / c
    left = 1.0 - used * used
    left *= left
    return left * plain - (1.0 - left) * elastic


VISCOSITY = Parameter(
    "viscosity",
    "s",
    least=0.0,
    path="stiffness.viscosity",
    meaning="Damping constant along a spring over its spring constant (Tarantino 1996)",
    domain=(0.005, 0.015),
)
YIELD_STRETCH = Parameter(
    "yield_stretch",
    "1",
    NEVER_YIELDS,
    least=1.0,
    path="stiffness.yield_stretch",
    meaning="Length over rest length above which the spring force stays constant (Tarantino 1996)",
    domain=(2.0, 4.0),
)
CORRECTION_LIMIT = Parameter(
    "correction_limit",
    "1",
    0.1,
    least=0.001,
    of="world",
    path="correction_limit",
    meaning="Strain beyond which a spring is shortened",
    domain=(0.3, 0.7),
)


def dashpot(stiffness: Any, viscosity: Any) -> Any:
    """Return the damping constant of a spring along it [N s/m]."""
    return viscosity * stiffness


RUBBER = Law(
    "spring",
    rubber,
    (VISCOSITY, YIELD_STRETCH),
    neutral={"viscosity": 0.0, "yield_stretch": NEVER_YIELDS},
    wants=lambda scene: scene.correction != "tarantino",
    drag=dashpot,
)
RUBBER_AT_LIMIT = Law(
    "spring",
    rubber_at_limit,
    (VISCOSITY, YIELD_STRETCH, CORRECTION_LIMIT),
    wants=lambda scene: scene.correction == "tarantino",
    drag=dashpot,
)


@wp.func
def string(squared_length: float, stiffness: float, stiffness_times_length: float):
    """Force per unit displacement [N/m]: a spring while taut, nothing while slack."""
    return wp.max(hooke(squared_length, stiffness, stiffness_times_length), 0.0)


@wp.func
def string_energy(squared_length: float, rest_length: float, stiffness: float):
    """Return the energy of a spring while taut [J]."""
    return wp.where(
        squared_length > rest_length * rest_length, hooke_energy(squared_length, rest_length, stiffness), 0.0
    )


STRING = Law(
    "string",
    string,
    energy=string_energy,
    wants=lambda scene: bool(scene.string),
    stiffness=lambda stiffness: stiffness,
)
FIRST_END = wp.constant(0)
FIRST_WING = wp.constant(2)
SECOND_WING = wp.constant(3)


@wp.func
def angle_beyond(a: wp.vec3, b: wp.vec3, first: wp.vec3, second: wp.vec3, rest_angle: float):
    """Return the angle between the two faces beyond the rest angle, from -pi to pi [rad]."""
    edge = b - a
    first_normal = wp.cross(edge, first - a)
    second_normal = wp.cross(second - a, edge)
    length = wp.sqrt(squared_length(edge))
    angle = wp.atan2(wp.dot(wp.cross(first_normal, second_normal), edge) / length, wp.dot(first_normal, second_normal))
    beyond = angle - rest_angle
    return beyond - 2.0 * wp.pi * wp.round(beyond / (2.0 * wp.pi))


@wp.func
def torsion(role: wp.int32, a: wp.vec3, b: wp.vec3, first: wp.vec3, second: wp.vec3, bend: float, torsion: float):
    """Force [N] on one of the four places of a hinge.

    It is minus the constant [N m/rad] times the angle beyond the rest angle, times the angle's gradient.

    Args:
        role: which place: a, b, first or second.
    """
    edge = b - a
    squared_edge = squared_length(edge)
    length = wp.sqrt(squared_edge)
    first_normal = wp.cross(edge, first - a)
    second_normal = wp.cross(second - a, edge)
    moment = torsion * bend
    on_first = (moment * length / squared_length(first_normal)) * first_normal
    on_second = (moment * length / squared_length(second_normal)) * second_normal
    if role == FIRST_WING:
        return on_first
    if role == SECOND_WING:
        return on_second
    along_first = wp.dot(first - a, edge) / squared_edge
    along_second = wp.dot(second - a, edge) / squared_edge
    if role == FIRST_END:
        along_first = 1.0 - along_first
        along_second = 1.0 - along_second
    return -(along_first * on_first + along_second * on_second)


@wp.func
def torsion_energy(bend: float, torsion: float):
    """Return the energy of a hinge, 1/2 constant angle^2 [J]."""
    return 0.5 * torsion * bend * bend


TORSION = Law(
    "hinge",
    torsion,
    (
        Parameter(
            "torsion",
            "N m/rad",
            least=0.0,
            path="stiffness.torsion",
            meaning="Torsional stiffness of each edge between two faces, against a change of the dihedral angle",
            domain=(0.05, 0.15),
        ),
    ),
    energy=torsion_energy,
    neutral={"torsion": 0.0},
    stiffness=lambda torsion: torsion,
)

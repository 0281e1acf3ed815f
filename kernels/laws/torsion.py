"""Torsion springs: across each edge, the angle between its two faces is kept instead of a length.

A face is seen at the mean of its corners beside the edge, which share the force there alike. The forces of a hinge come
of an angle that no movement of the whole changes, so that they have neither a sum nor a moment.
"""

import warp as wp

from balloon_warp.kernels.algebra import squared_length
from balloon_warp.kernels.laws.law import Law, Parameter

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

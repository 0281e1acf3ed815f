"""Torsion springs: across each edge, the angle between its two faces is kept instead of a length.

A face is seen at the mean of its corners beside the edge, which share the force there alike. The forces of a hinge come
of an angle that no movement of the whole changes, so that they have neither a sum nor a moment.
"""

import warp as wp

from balloon_warp.kernels.springs import squared_length
from balloon_warp.kernels.tables import HingeTable, row_of_world

FIRST_END = wp.constant(0)
SECOND_END = wp.constant(1)
FIRST_WING = wp.constant(2)
SECOND_WING = wp.constant(3)


@wp.func
def wrapped(angle: float):
    """The same angle from -pi to pi."""
    return angle - 2.0 * wp.pi * wp.round(angle / (2.0 * wp.pi))


@wp.func
def torsion_force(
    role: wp.int32, a: wp.vec3, b: wp.vec3, first: wp.vec3, second: wp.vec3, rest_angle: float, stiffness: float
):
    """Force [N] on one of the four places of a hinge: minus stiffness [N m/rad] times the angle beyond the rest angle,
    times the angle's gradient.

    Args:
        role: which place: `FIRST_END` a, `SECOND_END` b, `FIRST_WING` or `SECOND_WING`.
    """
    edge = b - a
    squared_edge = squared_length(edge)
    length = wp.sqrt(squared_edge)
    first_normal = wp.cross(edge, first - a)
    second_normal = wp.cross(second - a, edge)
    angle = wp.atan2(wp.dot(wp.cross(first_normal, second_normal), edge) / length, wp.dot(first_normal, second_normal))
    moment = stiffness * wrapped(angle - rest_angle)
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
def wing_size(hinges: HingeTable, hinge: wp.int32, wing: wp.int32):
    """Corners of a hinge's first (0) or second (1) wing."""
    return hinges.wing_offsets[2 * hinge + wing + 1] - hinges.wing_offsets[2 * hinge + wing]


@wp.func
def share_of_role(hinges: HingeTable, hinge: wp.int32, role: wp.int32):
    """The part of the force at a place that one of its particles gets."""
    if role < FIRST_WING:
        return 1.0
    return 1.0 / float(wing_size(hinges, hinge, role - FIRST_WING))


@wp.func
def torsion_stiffness(hinges: HingeTable, world: wp.int32, balloon: wp.int32):
    """[N m/rad]"""
    return hinges.stiffness[row_of_world(world, hinges.stiffness.shape[0]), balloon]


@wp.func
def wing_in_world(hinges: HingeTable, points: wp.array[wp.vec3], hinge: wp.int32, wing: wp.int32):
    """Where a wing is."""
    total = wp.vec3()
    for corner in range(hinges.wing_offsets[2 * hinge + wing], hinges.wing_offsets[2 * hinge + wing + 1]):
        total += points[hinges.wing_particles[corner]]
    return total / float(wing_size(hinges, hinge, wing))


@wp.kernel
def add_torsion_forces(
    # model
    hinges: HingeTable,
    particle_balloon: wp.array[wp.int32],
    # state in
    points: wp.array2d[wp.vec3],
    # state out
    forces: wp.array2d[wp.vec3],
):
    """A thread a (world, hinge): forces on its two ends and on the corners of its wings."""
    world, hinge = wp.tid()
    ends = hinges.ends[hinge]
    a = points[world, ends[0]]
    b = points[world, ends[1]]
    first = wing_in_world(hinges, points[world], hinge, 0)
    second = wing_in_world(hinges, points[world], hinge, 1)
    stiffness = torsion_stiffness(hinges, world, particle_balloon[ends[0]])
    rest = hinges.rest_angles[hinge]
    wp.atomic_add(forces, world, ends[0], torsion_force(FIRST_END, a, b, first, second, rest, stiffness))
    wp.atomic_add(forces, world, ends[1], torsion_force(SECOND_END, a, b, first, second, rest, stiffness))
    for wing in range(2):
        force = torsion_force(FIRST_WING + wing, a, b, first, second, rest, stiffness)
        share = share_of_role(hinges, hinge, FIRST_WING + wing)
        for corner in range(hinges.wing_offsets[2 * hinge + wing], hinges.wing_offsets[2 * hinge + wing + 1]):
            wp.atomic_add(forces, world, hinges.wing_particles[corner], share * force)

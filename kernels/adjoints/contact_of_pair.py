"""Adjoint of one contact of a particle with a triangle, which Warp derives of the law's own functions.

Frozen is which triangle it is, on which side of it the particle is, and whether they touch.
"""

import warp as wp

from balloon_warp.kernels.loops.meeting import Touching, corner_counts, faced, place_beside, touch


@wp.struct
class WorthOfContact:
    """Derivatives of the loss by the results of a contact."""

    a: wp.vec3  # by the force on each corner, less that by the force on the particle
    b: wp.vec3
    c: wp.vec3
    hold: wp.vec4
    counts: wp.vec3  # by each corner's share in the count of contacts


@wp.struct
class BarsOfContact:
    """Derivatives of the loss by the inputs of a contact."""

    point: wp.vec3
    velocity: wp.vec3
    corners: wp.mat33
    moving: wp.mat33
    hold: wp.vec4
    inputs: Touching
    pushes: bool  # whether it is one that pushes


@wp.func
def work_of_contact(
    point: wp.vec3, velocity: wp.vec3, corners: wp.mat33, moving: wp.mat33, hold: wp.vec4, inputs: Touching,
    worth: WorthOfContact,
):  # fmt: skip
    """Return the results of a contact that pushes, times their bars."""
    beside = place_beside(point, corners[0], corners[1], corners[2])
    place = faced(beside, corners[0], corners[1], corners[2])
    forces = touch(inputs, place, hold, velocity, corners, moving)
    pushes = wp.dot(forces.a, worth.a) + wp.dot(forces.b, worth.b) + wp.dot(forces.c, worth.c)
    return pushes + wp.dot(forces.hold, worth.hold) + wp.dot(corner_counts(place, corners), worth.counts)


@wp.func
def work_of_counts(point: wp.vec3, corners: wp.mat33, worth: wp.vec3):
    """Return the corners' shares in the count of contacts, times their bars."""
    beside = place_beside(point, corners[0], corners[1], corners[2])
    place = faced(beside, corners[0], corners[1], corners[2])
    return wp.dot(corner_counts(place, corners), worth)


@wp.func
def contact_back(
    point: wp.vec3, velocity: wp.vec3, corners: wp.mat33, moving: wp.mat33, hold: wp.vec4, inputs: Touching,
    worth: WorthOfContact,
):  # fmt: skip
    """Return the derivatives by the inputs of a contact that pushes."""
    bars = BarsOfContact()
    by_point, by_velocity, by_corners, by_moving, by_hold, by_inputs, _worth = wp.grad(work_of_contact)(
        point, velocity, corners, moving, hold, inputs, worth
    )
    bars.point = by_point
    bars.velocity = by_velocity
    bars.corners = by_corners
    bars.moving = by_moving
    bars.hold = by_hold
    bars.inputs = by_inputs
    return bars


@wp.func
def counts_back(point: wp.vec3, corners: wp.mat33, worth: wp.vec3):
    """Return the derivatives by the inputs of the count of a contact that is only near."""
    bars = BarsOfContact()
    by_point, by_corners, _worth = wp.grad(work_of_counts)(point, corners, worth)
    bars.point = by_point
    bars.corners = by_corners
    return bars

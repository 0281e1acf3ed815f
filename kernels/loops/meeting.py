"""Contact of a particle with triangles, of its own balloon or another: geometry and forces.

See `laws.touch`.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.touch import (
    NEAR,
    across,
    facing,
    nearest_weights,
    quotient,
    reach_gradient,
    share_of_contact,
    touch_friction,
    touch_push,
    weighted,
)
from balloon_warp.kernels.tables import Tables, row_of_world

AS_NEAR = wp.constant(1.0e-5)
"""Relative difference of distance below which two triangles count as equally near, at a shared edge"""
FARTHEST = wp.constant(1.0e30)
"""Squared distance beyond all others [m^2]"""
LITTLE = wp.constant(0.01)
"""Barycentric weight by which a contact may be beyond an edge"""
SOON = wp.constant(2.0)
"""Number of substeps ahead in which a coming contact is counted"""
CAREFUL = wp.constant(0.99)
"""Fraction of a distance that is safe from rounding"""
APART_RATE = wp.constant(10.0)
"""Rate at which an overlap from the start decays [1/s]"""


@wp.struct
class Place:
    """Position of a particle relative to a triangle."""

    weights: wp.vec3  # of the nearest point
    arm: wp.vec3  # from there to the particle [m]
    squared: float  # distance [m^2]
    area_vector: wp.vec3  # twice the triangle's area along its normal [m^2]
    normal: wp.vec3  # n, and
    gap: float  # [m], negative from behind: of the nearest triangle alone, see `faced`


@wp.func
def place_beside(point: wp.vec3, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return the position of a particle relative to a triangle, without normal and gap."""
    place = Place()
    place.weights = nearest_weights(point, a, b, c)
    place.arm = point - weighted(place.weights, a, b, c)
    place.squared = wp.length_sq(place.arm)
    place.area_vector = wp.cross(b - a, c - a)
    return place


@wp.func
def faced(place: Place, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return the position of a particle relative to a triangle, with normal and gap.

    Nothing is overwritten, so that Warp can derive it.
    """
    here = Place()
    here.arm = place.arm
    here.squared = place.squared
    here.area_vector = place.area_vector
    here.normal = facing(place.arm, place.weights, place.area_vector)
    here.gap = wp.dot(place.arm, here.normal)
    # beside an edge, so near that it is taken along the normal: the place met is below it, a little beyond the edge
    beyond = across(place.arm, here.normal)
    more = wp.vec3(
        wp.dot(reach_gradient(here.normal, c - b, place.area_vector), beyond),
        wp.dot(reach_gradient(here.normal, a - c, place.area_vector), beyond),
        wp.dot(reach_gradient(here.normal, b - a, place.area_vector), beyond),
    )
    has_height = wp.length_sq(more) < LITTLE * LITTLE
    here.weights = wp.where(has_height, place.weights + more, place.weights)
    return here


@wp.func
def steepness(place: Place):
    """Return the cosine between the arm and the triangle's normal, from 0 to 1."""
    rise = wp.abs(wp.dot(place.arm, place.area_vector))
    return quotient(rise, wp.length(place.arm) * wp.length(place.area_vector))


@wp.func
def is_nearer(place: Place, other: Place):
    """Return whether a triangle is nearer than another.

    The one of two that faces the particle counts as nearer where they share the closest point: it decides the side.
    """
    if wp.abs(place.squared - other.squared) <= AS_NEAR * other.squared:
        return steepness(place) > steepness(other)
    return place.squared < other.squared


@cache
def skin_functions(features: Features) -> tuple[Any, Any]:
    """Return the functions for the contact's thickness [m] and stiffness [N/m] between two balloons."""
    split = features.columns.balloon_width
    thickness_column = features.columns.places["touch_thickness"] - split
    stiffness_column = features.columns.places["touch_stiffness"] - split

    @wp.func
    def thickness_between(t: Tables, world: wp.int32, first: wp.int32, second: wp.int32):
        said = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), thickness_column]
        thickness = 0.5 * (t.touch.thickness[first] + t.touch.thickness[second])
        return wp.where(said < 0.0, thickness, said)

    @wp.func
    def stiffness_between(t: Tables, world: wp.int32, first: wp.int32, second: wp.int32):
        """Return the contact stiffness of two skins in series, scaled so that two equal ones are as stiff as each."""
        said = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), stiffness_column]
        row = row_of_world(world, t.touch.stiffness.shape[0])
        a = t.touch.stiffness[row, first]
        b = t.touch.stiffness[row, second]
        return wp.where(said < 0.0, quotient(2.0 * a * b, a + b), said)

    return thickness_between, stiffness_between


@wp.struct
class Touching:
    """Parameters of a contact, besides its geometry."""

    side: float  # 1 in front of the triangle, -1 behind it
    thickness: float  # [m]
    stiffness: float  # [N/m]
    friction: float
    crowd: float  # contacts of the busiest of the four, over those that the step allows for
    masses: wp.vec4  # 1 over those of particle and corners [1/kg]
    first: bool  # whether the particle's hold is of this contact
    step_seconds: float


@wp.struct
class ContactForces:
    """The forces on a triangle's corners [N]; that on the particle makes their sum nothing. The hold after it, too."""

    a: wp.vec3
    b: wp.vec3
    c: wp.vec3
    hold: wp.vec4


@wp.func
def what_pushes(pushed: float, overlap: float, approach: float, step_seconds: float):
    """Return the part of an overlap that pushes [m].

    It is the part that came about by moving, so that it has taken the energy that it gives. The rest was there at the
    start, or is there because another triangle, or another side, has become the nearest; it begins to push slowly.

    Args:
        pushed: Part that pushed before [m].
    """
    before = wp.min(pushed, overlap)
    rest = overlap - before
    more = wp.where(approach > -APART_RATE * rest, (APART_RATE * step_seconds) * rest, 0.0)
    come = before + step_seconds * approach + more
    return wp.clamp(come, 0.0, overlap)


@wp.func
def reach_of(place: Place, corners: wp.mat33):
    """Return G of each corner, row by row [1/m].

    Zero where the arm is longer than the triangle is high, which would need excessively large forces.
    """
    first = reach_gradient(place.normal, corners[2] - corners[1], place.area_vector)
    second = reach_gradient(place.normal, corners[0] - corners[2], place.area_vector)
    third = reach_gradient(place.normal, corners[1] - corners[0], place.area_vector)
    steepest = wp.max(wp.max(wp.length_sq(first), wp.length_sq(second)), wp.length_sq(third))
    if place.gap * place.gap * steepest >= 1.0:
        return wp.mat33()
    return wp.matrix_from_rows(first, second, third)


@wp.func
def is_clear(side: float, place: Place, thickness: float, seconds: float, velocity: wp.vec3, moving: wp.mat33):
    """Return whether a particle is so far in front of its nearest triangle that there is no contact now or soon.

    Most particles are, and this test costs less than `comes_at`.

    Args:
        seconds: Time within which a contact counts.
    """
    distance = wp.sqrt(place.squared)
    along_arm = place.squared > NEAR * NEAR * wp.length(place.area_vector)  # where the gap is the distance
    in_front = side * wp.dot(place.arm, place.area_vector) > 0.0
    relative = velocity - weighted(place.weights, moving[0], moving[1], moving[2])
    return along_arm and in_front and CAREFUL * distance > thickness + seconds * wp.length(relative)


@wp.func
def overlap_of(inputs: Touching, place: Place):
    """Return the overlap of a particle with the skin of its triangle [m], negative where there is a gap between."""
    return inputs.thickness - inputs.side * place.gap


@wp.func
def comes_at(inputs: Touching, place: Place, velocity: wp.vec3, moving: wp.mat33):
    """Return whether a particle touches, or will within two substeps at its velocity: such contacts are counted."""
    relative = velocity - weighted(place.weights, moving[0], moving[1], moving[2])
    approach = -inputs.side * wp.dot(relative, place.normal)
    return overlap_of(inputs, place) + SOON * inputs.step_seconds * wp.max(approach, 0.0) > 0.0


@wp.func
def corner_counts(place: Place, corners: wp.mat33):
    """Return the share of each corner of a triangle in a contact's count, by the forces that it bears.

    The particle counts a whole contact.
    """
    reach = reach_of(place, corners)
    arm = wp.abs(place.gap)
    return place.weights + arm * wp.vec3(wp.length(reach[0]), wp.length(reach[1]), wp.length(reach[2]))


@wp.func
def touch(inputs: Touching, place: Place, hold: wp.vec4, velocity: wp.vec3, corners: wp.mat33, moving: wp.mat33):
    """Return the forces of a contact.

    Args:
        hold: State of the particle's contact before.
        corners: Positions of the triangle's corners, row by row [m].
        moving: Velocities of the corners [m/s].
    """
    normal = inputs.side * place.normal
    gap = inputs.side * place.gap
    reach = reach_of(place, corners)
    first = reach[0]
    second = reach[1]
    third = reach[2]
    reaches = wp.ddot(reach, reach) > 0.0
    w = place.weights
    rises = wp.vec3(wp.dot(moving[0], normal), wp.dot(moving[1], normal), wp.dot(moving[2], normal))
    relative = velocity - weighted(w, moving[0], moving[1], moving[2]) + gap * weighted(rises, first, second, third)
    approach = -wp.dot(relative, normal)
    share = share_of_contact(inputs.crowd)
    root = wp.sqrt(share)  # a contact keeps its energy's root, which stays where its share changes
    stiffness = share * inputs.stiffness
    mass = share / (
        inputs.masses[0]
        + w[0] * w[0] * inputs.masses[1]
        + w[1] * w[1] * inputs.masses[2]
        + w[2] * w[2] * inputs.masses[3]
    )
    slip = wp.vec3()
    overlap = wp.min(overlap_of(inputs, place), inputs.thickness)
    if inputs.first:
        overlap = what_pushes(wp.abs(hold[3]) / root, overlap_of(inputs, place), approach, inputs.step_seconds)
        slip = wp.vec3(hold[0], hold[1], hold[2]) / root
    push = touch_push(overlap, approach, stiffness, mass)
    force = push * normal
    forces = ContactForces()
    pull = wp.vec3()
    if reaches:
        slide = across(relative, normal)
        slip = across(slip, normal) + inputs.step_seconds * slide
        pull, slip = touch_friction(slip, slide, inputs.friction * push, stiffness, mass)
        force += pull
    forces.a = -w[0] * force + (gap * wp.dot(first, pull)) * normal
    forces.b = -w[1] * force + (gap * wp.dot(second, pull)) * normal
    forces.c = -w[2] * force + (gap * wp.dot(third, pull)) * normal
    slip *= root
    forces.hold = wp.vec4(slip[0], slip[1], slip[2], inputs.side * wp.max(root * overlap, 1.0e-20))
    return forces

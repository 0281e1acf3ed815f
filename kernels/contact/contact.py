"""Contact law of all kinds of features: impulse, friction, and separation of overlaps.

With w the weights of the ends, u their velocities, as all other forces would leave them, and u_s that of a solid, n the
unit vector along which the features part, g their distance and d the one that they keep, an impulse along n lets them
come nearer by no more than is left,

    n . (sum w u - u_s) >= -max(g - d, 0) / h.

Each end gets it by its weight, and the solid the opposite: so momentum and angular momentum stay, kinetic energy does
not grow, no side has to be remembered, and none is crossed. Friction is Coulomb's, an impulse against the slip up to
friction times that along n; couples along n at pairs of ends bear the torque that it has where the features are apart.

All contacts of a sweep act at once. Each of N contacts on a particle, or on a solid, has an Nth of its mass for itself,
and afterwards the parts go on with their mean velocity (Tonge, Benevolenski and Voroshilov 2012, *Mass splitting for
jitter-free parallel rigid body simulation*). Each contact alone finds the nearest allowed velocities of its parts,
measured by kinetic energy, and so does the mean: it never grows.

All is a function of plain values, so that Warp derives it.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import spin_by
from balloon_warp.kernels.laws.rigid import spin_of
from balloon_warp.kernels.laws.touch import FOUR, LEAST, across

NONE = wp.constant(-1)
"""Solid of a contact of balloons alone"""
FIXED, BODY, BALL = (wp.constant(kind) for kind in range(3))
"""Kinds of solids: none, or an obstacle, which goes its way; a free body; a sphere"""


@wp.struct
class Contact:
    """Features that may touch in a substep, as they were at its start."""

    ends: wp.vec4i  # particles of the features; where there are fewer, the others bear nothing
    weights: wp.vec4  # of their velocities in the one by which the features part
    normal: wp.vec3  # along which they part; zero if they do not meet
    gap: float  # [m]
    kept: float  # distance that they keep [m]
    left: float  # by how much they may come nearer in a substep, left to the next one [m]
    overlap: float  # by which they are parted, without speed [m]
    friction: float
    couple: wp.vec3  # at the first two ends, by 1 N s of friction along each axis, see `laws.touch`
    other_couple: wp.vec3  # at the other two
    solid: wp.int32
    arm: wp.vec3  # from the solid's center to the balloon's point [m]
    moving: wp.vec3  # how fast the surface of an obstacle moves there [m/s]
    pair: wp.int32  # its number among those that are near
    marked: wp.int32  # of this place in the list: which of the contacts comes too near in a sweep


@wp.struct
class Bearing:
    """Inverse masses at a contact's ends, and contact counts that divide them."""

    inverse_masses: wp.vec4  # of the ends [1/kg]
    shares: wp.vec4
    kind: wp.int32  # of the solid
    share: float  # contacts of the solid
    mass: float  # of that [kg]
    turn: wp.quat  # of a body as the substep begins
    inverse_inertia: wp.mat33  # of a body, the inverse inertia tensor of 1 kg [1/m^2]
    radius: float  # of a sphere [m]


@wp.struct
class Motion:
    """Velocity and spin of a solid."""

    velocity: wp.vec3
    spin: wp.vec3  # [rad/s]


@wp.struct
class ContactImpulses:
    """Impulse of a contact on the balloon's point [N s], and its couples along n at the ends."""

    impulse: wp.vec3
    couples: wp.vec2  # at the first two ends, and at the other two


@wp.func
def bears(contact: Contact, end: wp.int32):
    """Test for a movable end of a contact; without one, there is no friction."""
    return contact.weights[end] != 0.0


@wp.func
def excess_of(contact: Contact, relative: wp.vec3, step_seconds: float):
    """Excess approach speed of a contact [m/s].

    Args:
        relative: Velocity by which the features part [m/s].
    """
    return -wp.dot(relative, contact.normal) - wp.max(contact.gap - contact.kept, 0.0) / step_seconds


@wp.func
def on_end(contact: Contact, impulses: ContactImpulses, end: wp.int32):
    """Return the impulse on an end [N s]."""
    couple = wp.where(end < 2, impulses.couples[0], impulses.couples[1])
    turned = wp.where(end % 2 == 0, -couple, couple)
    return contact.weights[end] * impulses.impulse + turned * contact.normal


@wp.func
def opening_of(moving: FOUR, contact: Contact, inverse_masses: wp.vec4, push: float):
    """Speed along n at which each pair of ends opens after a push [m/s]."""
    gains = push * wp.cw_mul(inverse_masses, contact.weights)
    first = wp.dot(moving[1] - moving[0], contact.normal) + gains[1] - gains[0]
    return wp.vec2(first, wp.dot(moving[3] - moving[2], contact.normal) + gains[3] - gains[2])


@cache
def resolving_functions(features: Features) -> tuple[Any, Any, Any]:
    """Functions of a contact: relative velocity, impulses against it, and impulses that separate it."""

    @wp.func
    def relative_of(contact: Contact, moving: FOUR, kind: wp.int32, solid: Motion):
        """Separation velocity of features [m/s], from those of the ends, row by row."""
        beside = contact.weights * moving
        if wp.static(features.ridges):
            if kind == FIXED:
                return beside - contact.moving
        if wp.static(features.bodies > 0 or features.spheres_rub):
            return beside - solid.velocity - wp.cross(solid.spin, contact.arm)
        return beside - solid.velocity

    @wp.func
    def gain_along(contact: Contact, bearing: Bearing, along: wp.vec3):
        """Return the velocity by which the features part after an impulse of 1 N s along a unit vector [1/kg]."""
        inverse_mass = wp.dot(
            wp.cw_mul(contact.weights, contact.weights), wp.cw_mul(bearing.shares, bearing.inverse_masses)
        )
        gain = inverse_mass * along
        if wp.static(features.bodies > 0):
            if bearing.kind == BODY:
                twist = spin_of(bearing.turn, bearing.inverse_inertia, bearing.mass, wp.cross(contact.arm, along))
                gain += bearing.share * (along / bearing.mass + wp.cross(twist, contact.arm))
        if wp.static(features.round_ridges):
            if bearing.kind == BALL:
                of_ball = along / bearing.mass
                if wp.static(features.spheres_rub):
                    turning = spin_by(bearing.mass, bearing.radius, wp.cross(contact.arm, along))
                    of_ball += wp.cross(turning, contact.arm)
                gain += bearing.share * of_ball
        return gain

    @wp.func
    def impulses_of(contact: Contact, bearing: Bearing, moving: FOUR, relative: wp.vec3, step_seconds: float):
        """Return the impulse that keeps features apart, with friction."""
        impulses = ContactImpulses()
        along = gain_along(contact, bearing, contact.normal)
        excess = wp.max(excess_of(contact, relative, step_seconds), 0.0)
        push = excess / wp.max(wp.dot(along, contact.normal), LEAST)
        impulses.impulse = push * contact.normal
        if contact.friction > 0.0:
            inverse_masses = wp.cw_mul(bearing.shares, bearing.inverse_masses)
            opening = opening_of(moving, contact, inverse_masses, push)
            slide = across(relative + push * along, contact.normal)
            slide += opening[0] * contact.couple + opening[1] * contact.other_couple
            if wp.length_sq(slide) > 0.0:
                ahead = wp.normalize(slide)
                couples = wp.vec2(wp.dot(ahead, contact.couple), wp.dot(ahead, contact.other_couple))
                inverse_mass = wp.dot(gain_along(contact, bearing, ahead), ahead)
                inverse_mass += couples[0] * couples[0] * (inverse_masses[0] + inverse_masses[1]) + couples[
                    1
                ] * couples[1] * (inverse_masses[2] + inverse_masses[3])
                rub = wp.min(wp.length(slide) / wp.max(inverse_mass, LEAST), contact.friction * push)
                impulses.impulse = impulses.impulse - rub * ahead
                impulses.couples = -rub * couples
        return impulses

    @wp.func
    def parting_of(contact: Contact, bearing: Bearing):
        """Return the move times mass [kg m], as an impulse, that parts features by their overlap, without speed."""
        impulses = ContactImpulses()
        along = gain_along(contact, bearing, contact.normal)
        impulses.impulse = (contact.overlap / wp.max(wp.dot(along, contact.normal), LEAST)) * contact.normal
        return impulses

    return relative_of, impulses_of, parting_of

"""Adjoint of one contact, which Warp derives of the functions of all kinds, see `contact.contact`.

Frozen is which features they are, and whether they come too near.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.contact import (
    BALL,
    Answer,
    Bearing,
    Contact,
    Motion,
    on_end,
    resolving_functions,
)
from balloon_warp.kernels.contact.ends import gains_of_ball_function
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.ridges import FOUR


@cache
def works_of_contact(features: Features) -> tuple[Any, Any]:
    """Return the functions of the gains of all ends by a push, and by a parting, times their bars."""
    relative_of, answer_of, parting_of = resolving_functions(features)
    gains_of_ball = gains_of_ball_function(features)

    @wp.func
    def work_of_answer(contact: Contact, bearing: Bearing, answer: Answer, worth: FOUR, of_solid: Motion):
        work = float(0.0)
        work += bearing.eases[0] * wp.dot(on_end(contact, answer, 0), worth[0])
        work += bearing.eases[1] * wp.dot(on_end(contact, answer, 1), worth[1])
        work += bearing.eases[2] * wp.dot(on_end(contact, answer, 2), worth[2])
        work += bearing.eases[3] * wp.dot(on_end(contact, answer, 3), worth[3])
        if wp.static(features.round_ridges):
            if bearing.kind == BALL:
                torque = wp.cross(contact.arm, -answer.impulse)
                gains = gains_of_ball(bearing.mass, bearing.radius, -answer.impulse, torque)
                work += wp.dot(gains.velocity, of_solid.velocity) + wp.dot(gains.spin, of_solid.spin)
        return work

    @wp.func
    def work_of_push(
        contact: Contact, moving: FOUR, solid: Motion, bearing: Bearing, step_seconds: float, worth: FOUR,
        of_solid: Motion,
    ):  # fmt: skip
        relative = relative_of(contact, moving, bearing.kind, solid)
        answer = answer_of(contact, bearing, moving, relative, step_seconds)
        return work_of_answer(contact, bearing, answer, worth, of_solid)

    @wp.func
    def work_of_parting(contact: Contact, bearing: Bearing, worth: FOUR, of_solid: Motion):
        return work_of_answer(contact, bearing, parting_of(contact, bearing), worth, of_solid)

    return work_of_push, work_of_parting


@wp.func
def worth_of_contact(contact: Contact, by: Contact):
    """Return the numbers of a contact, times the derivatives by them."""
    found = wp.dot(contact.weights, by.weights) + wp.dot(contact.normal, by.normal) + contact.gap * by.gap
    found += contact.kept * by.kept + contact.overlap * by.overlap + wp.dot(contact.couple, by.couple)
    found += wp.dot(contact.other_couple, by.other_couple)
    return found + wp.dot(contact.arm, by.arm) + wp.dot(contact.moving, by.moving)


@wp.func
def sum_of_contacts(one: Contact, other: Contact):
    """Return the sum of derivatives by a contact."""
    total = Contact()
    total.weights = one.weights + other.weights
    total.normal = one.normal + other.normal
    total.gap = one.gap + other.gap
    total.kept = one.kept + other.kept
    total.overlap = one.overlap + other.overlap
    total.friction = one.friction + other.friction
    total.couple = one.couple + other.couple
    total.other_couple = one.other_couple + other.other_couple
    total.arm = one.arm + other.arm
    total.moving = one.moving + other.moving
    return total

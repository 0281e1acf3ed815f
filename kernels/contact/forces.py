"""What contacts do to particles, and how many each has: added up by whoever finds them, in any order, and taken by the
particles. Forces are whole numbers, which add up to the same in any order."""

from typing import Any

import warp as wp

from balloon_warp.kernels.fixed_point import growth, quanta
from balloon_warp.kernels.memory import byte_in
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.phases.move import kick
from balloon_warp.kernels.working import Working

wp.set_module_options(OPTIONS)

CONTACTS = wp.constant(3)
"""the sum of a particle's that counts them, after its forces'"""
UNTOUCHED, TOUCHED, COUNTED = wp.constant(wp.int8(0)), wp.constant(wp.int8(1)), wp.constant(wp.int8(2))
"""what contacts have to do with a particle: nothing; they push or soon will, or it is a corner of what they do to; or
did so in the substep before, of which their number is left"""


@wp.func
def add_pushes(
    totals: wp.array3d[wp.int64],
    world: wp.int32,
    particle: wp.int32,
    corners: wp.vec3i,
    a: wp.vec3,
    b: wp.vec3,
    c: wp.vec3,
):
    """Forces [N] on a triangle's corners, and on a particle what makes their sum nothing, to the last bit."""
    for axis in range(3):
        first = quanta(a[axis])
        second = quanta(b[axis])
        third = quanta(c[axis])
        wp.atomic_add(totals, world, corners[0], axis, first)
        wp.atomic_add(totals, world, corners[1], axis, second)
        wp.atomic_add(totals, world, corners[2], axis, third)
        wp.atomic_add(totals, world, particle, axis, -(first + second + third))


@wp.func
def add_contact(working: Working, world: wp.int32, particle: wp.int32, corners: wp.vec3i, counts: wp.vec3):
    """To how many contacts each has: one to the particle, and to a triangle's corners their counts."""
    wp.atomic_add(working.push_quanta, world, particle, CONTACTS, quanta(1.0))
    working.touched[world, particle] = TOUCHED
    for corner in range(3):
        wp.atomic_add(working.push_quanta, world, corners[corner], CONTACTS, quanta(counts[corner]))
        working.touched[world, corners[corner]] = TOUCHED


@wp.func
def tell_push(working: Working, world: wp.int32, particle: wp.int32, other: wp.int32, force: wp.vec3, seconds: float):
    """Add up what another balloon does to a particle: balloons are the last of all things."""
    thing = working.contact_pushes.shape[1] - working.balloon_boxes.shape[1] + other
    told = working.contact_pushes[world, thing, particle]
    push = seconds * force
    working.contact_pushes[world, thing, particle] = told + wp.vec4(push[0], push[1], push[2], seconds)


@wp.func
def take_pushes(working: Working, world: wp.int32, particle: wp.int32):
    """What contacts do to a particle [N], and nothing is left of it; and how many they are, for the next substep."""
    force = wp.vec3()
    mark = byte_in(working.touched, world, particle)
    if mark != UNTOUCHED:
        since = growth(working.push_quanta, working.pushes_taken, world, particle)
        force = wp.vec3(since[0], since[1], since[2])
        working.contacts[world, particle] = since[3]
        working.touched[world, particle] = wp.where(mark == TOUCHED, COUNTED, UNTOUCHED)
    return force


@wp.kernel(enable_backward=False)
def take_counts(
    threads: wp.int32,
    # in and out
    working: Working,
):
    """Some threads a world."""
    world, thread = wp.tid()
    for particle in range(thread, working.contacts.shape[1], threads):
        take_pushes(working, world, particle)


@wp.func
def pushed(working: Working, own: Any, gain: float, velocity: wp.vec3):
    """A particle's velocity once contacts have pushed it, too.

    Args:
        gain: see `response`.
    """
    return kick(velocity, take_pushes(working, own.world, own.number), gain)

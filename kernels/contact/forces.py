"""Contact forces on particles, and the number of contacts of each.

The threads that find contacts add to both in any order, and the particles take them. Forces are integers in fixed
point, whose sums do not depend on the order.
"""

import warp as wp

from balloon_warp.kernels.memory import byte_in
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.warps import growth, quanta
from balloon_warp.kernels.working import Working

wp.set_module_options(OPTIONS)

CONTACTS = wp.constant(3)
"""Index of the number of contacts among a particle's sums, after the forces"""
UNTOUCHED, TOUCHED, COUNTED = wp.constant(wp.int8(0)), wp.constant(wp.int8(1)), wp.constant(wp.int8(2))
"""Role of a particle in contacts: none; pushing or soon to push, or a corner that is pushed; or so in the previous
substep, of which the number of contacts is left"""


@wp.func
def add_contact_forces(
    totals: wp.array3d[wp.int64],
    world: wp.int32,
    particle: wp.int32,
    corners: wp.vec3i,
    a: wp.vec3,
    b: wp.vec3,
    c: wp.vec3,
):
    """Add forces [N] to a triangle's corners, and to a particle the exact opposite of their sum."""
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
    """Count a contact: one for the particle, and its corners' counts for a triangle."""
    wp.atomic_add(working.force_quanta, world, particle, CONTACTS, quanta(1.0))
    working.touched[world, particle] = TOUCHED
    for corner in range(3):
        wp.atomic_add(working.force_quanta, world, corners[corner], CONTACTS, quanta(counts[corner]))
        working.touched[world, corners[corner]] = TOUCHED


@wp.func
def record_impulse(
    working: Working, world: wp.int32, particle: wp.int32, other: wp.int32, force: wp.vec3, seconds: float
):
    """Add up the impulses of another balloon on a particle: balloons are the last of all things."""
    thing = working.contact_impulses.shape[1] - working.balloon_boxes.shape[1] + other
    before = working.contact_impulses[world, thing, particle]
    push = seconds * force
    working.contact_impulses[world, thing, particle] = before + wp.vec4(push[0], push[1], push[2], seconds)


@wp.func
def take_contact_forces(working: Working, world: wp.int32, particle: wp.int32):
    """Take the contact forces on a particle [N], and store its number of contacts for the next substep."""
    force = wp.vec3()
    mark = byte_in(working.touched, world, particle)
    if mark != UNTOUCHED:
        since = growth(working.force_quanta, working.forces_taken, world, particle)
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
    """Store the numbers of contacts, by some threads a world."""
    world, thread = wp.tid()
    for particle in range(thread, working.contacts.shape[1], threads):
        take_contact_forces(working, world, particle)

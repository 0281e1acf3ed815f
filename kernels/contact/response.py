"""Balloons that touch push each other off: forces on a particle after the other, where each piece is a launch.

Contact forces on particles, and the number of contacts of each. The threads that find contacts add to both in any
order, and the particles take them. Forces are integers in fixed point, whose sums do not depend on the order.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.contact.free_frames import BUSY, FREE
from balloon_warp.kernels.contact.triangles import (
    eight_of_list,
    find_places,
    is_first_of_balloon,
    on_side,
    pair_functions,
    place_of,
    rows_at,
    triangle_of,
)
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.contact import (
    FARTHEST,
    SOON,
    Place,
    comes_at,
    corner_counts,
    faced,
    is_clear,
    is_nearer,
    overlap_of,
    place_beside,
    touch,
)
from balloon_warp.kernels.memory import byte_in, four_in, four_on_page, int_at, one_of_four, triple_at, vector_at
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import growth, quanta
from balloon_warp.kernels.working import PAIRS, TOUCHING, Working

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


@wp.kernel(enable_backward=False)
def find_clear_worlds(
    threads: wp.int32,
    # in and out
    working: Working,
):
    """Judge worlds clear for which a search has listed nothing, by some threads a world.

    Their particles touch nothing, of which those in contact until now take notice.
    """
    world, thread = wp.tid()
    clear = working.list_lengths[world, TOUCHING] == 0 and working.list_lengths[world, PAIRS] == 0
    if thread == 0:
        working.verdicts[world] = wp.where(clear, FREE, BUSY)
        if not clear:
            working.any_busy[0] = 1
    if clear:
        for particle in range(thread, working.contacts.shape[1], threads):
            working.contacts[world, particle] = 0.0
            working.touched[world, particle] = UNTOUCHED


RESPONSE_REGISTERS = 96
"""Registers of a thread: a multiprocessor then has 20 warps, whose memory latencies overlap, and 12 without a limit"""


@cache
def response_function(features: Features) -> Any:
    """Contact force of a particle and one triangle."""
    beside, masses_of, pressed = pair_functions(features)

    @wp.func
    def respond(
        t: Tables,
        working: Working,
        world: wp.int32,
        particle: wp.int32,
        candidate: wp.int32,
        place: Place,
        points: Any,
        velocities: wp.array[wp.vec3],
        only_counts: bool,
        first: bool,
        hold: wp.vec4,
    ):
        """Press a particle against a triangle, and return its hold; zero if they do not touch."""
        corners = triple_at(t.touch.triangles, triangle_of(candidate))
        velocity = vector_at(velocities, particle)
        kept = wp.vec4()
        inputs = beside(t, world, particle, candidate, corners)
        moving = rows_at(velocities, corners)
        if is_clear(inputs.side, place, inputs.thickness, SOON * t.step_seconds, velocity, moving):
            return kept
        places = rows_at(points, corners)
        place = faced(place, places[0], places[1], places[2])
        inputs.masses = masses_of(t, world, particle, corners)
        if comes_at(inputs, place, velocity, moving):
            add_contact(working, world, particle, corners, corner_counts(place, places))
        if overlap_of(inputs, place) > 0.0 and wp.max(inputs.masses) > 0.0 and not only_counts:
            pressing = pressed(t, working, world, particle, corners, inputs, first)
            forces = touch(pressing, place, hold, velocity, places, moving)
            add_contact_forces(working.force_quanta, world, particle, corners, forces.a, forces.b, forces.c)
            if wp.static(features.tells_contacts):
                other = int_at(t.particles.balloon, corners[0])
                record_impulse(working, world, particle, other, -(forces.a + forces.b + forces.c), t.step_seconds)
            kept = forces.hold
        return kept

    return respond


@wp.struct
class Found:
    """Triangle of a balloon, among those of a particle's list, to which the particle is nearest."""

    nearest: wp.int32  # list entry, -1 if there is none
    place: Place  # beside that
    end: wp.int32  # of the balloon's triangles in the list


@cache
def nearest_function(features: Features, eight: bool = False) -> Any:
    """Return the function that finds the nearest triangle of the next balloon in a particle's list.

    Args:
        eight: whether it measures eight triangles at a time, with the same result to the bit.
    """
    sees_sides = features.touches_itself and features.edges_meet

    @wp.func
    def nearest_from(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, begin: wp.int32, count: wp.int32,
        points: wp.array[wp.vec3],
    ):  # fmt: skip
        """Return the nearest triangle of one balloon.

        Args:
            begin: First of the balloon's triangles in the list.
            count: Length of the list.
        """
        own = int_at(t.particles.balloon, particle)
        point = vector_at(points, particle)
        found = Found()
        found.nearest = wp.int32(-1)
        found.place.squared = FARTHEST
        four = four_on_page(working.candidates, world, particle, begin - begin % 4)
        at = begin
        beside = bool(True)
        listed = working.candidates[world, particle]
        places = working.eight_places[world]
        while at < count and beside:
            if at % 4 == 0:
                four = four_on_page(working.candidates, world, particle, at)
            candidate = one_of_four(four, at % 4)
            beside = at == begin or not is_first_of_balloon(candidate)
            if beside:
                numbers = triple_at(t.touch.triangles, triangle_of(candidate))
                if wp.static(eight):
                    if (at - begin) % 8 == 0:
                        find_places(points, t.touch.triangles, eight_of_list(listed, at, count), point, places)
                    place = place_of(places, (at - begin) % 8)
                else:
                    corners = rows_at(points, numbers)
                    place = place_beside(point, corners[0], corners[1], corners[2])
                if wp.static(sees_sides):  # impulses see to it that none comes through, see `contact.edges`
                    if int_at(t.particles.balloon, numbers[0]) == own:
                        candidate = on_side(candidate, place)
                if is_nearer(place, found.place):
                    found.nearest = candidate
                    found.place = place
                at += 1
        found.end = at
        return found

    return nearest_from


@cache
def response_kernel(features: Features, fast_math: bool = False, eight: bool = False) -> Any:
    """Return the kernel that presses particles against the triangles found near them.

    Args:
        eight: whether it measures eight triangles at a time, as on a CPU.
    """
    respond = response_function(features)
    nearest_from = nearest_function(features, eight)

    @wp.func
    def respond_to_contacts(
        t: Tables,
        state: WorldState,
        working: Working,
        world: wp.int32,
        particle: wp.int32,
        points: Any,
        velocities: wp.array[wp.vec3],
        only_counts: bool,
    ):
        """Press a particle against the nearest triangle of each balloon that is near."""
        count = working.candidate_counts[world, particle]
        hold = four_in(state.holds, world, particle)
        after = wp.vec4()
        found = Found()
        while found.end < count:
            found = nearest_from(t, working, world, particle, found.end, count, points)
            if found.nearest >= 0:  # a point that is not a number is near nothing
                first = after[3] == 0.0
                kept = respond(
                    t, working, world, particle, found.nearest, found.place, points, velocities, only_counts, first,
                    hold,
                )  # fmt: skip
                if first:
                    after = kept
        if not only_counts and (count > 0 or hold[3] != 0.0):
            state.holds[world, particle] = after

    @wp.kernel(
        module="unique",
        enable_backward=False,
        cuda_max_registers=RESPONSE_REGISTERS,
        module_options={**OPTIONS, "fast_math": fast_math},
    )
    def press_particles(
        # model
        t: Tables,
        threads: wp.int32,
        only_counts: wp.int32,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # state in and out
        state: WorldState,
        # out
        working: Working,
    ):
        """Press the particles of a world, by some threads a world.

        Args:
            only_counts: Whether contacts are only counted, without forces.
        """
        world, thread = wp.tid()
        for place in range(thread, working.list_lengths[world, TOUCHING], threads):
            particle = working.particle_lists[world, TOUCHING, place]
            respond_to_contacts(t, state, working, world, particle, points[world], velocities[world], only_counts == 1)

    return press_particles

"""Balloons that touch push each other off, where each piece of a substep is a launch: a particle after the other, with
forces as whole numbers, which add up to the same in any order."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.loops.meeting import (
    SOON,
    Place,
    Touching,
    comes_at,
    corner_counts,
    faced,
    is_clear,
    is_nearer,
    pair_friction_function,
    skin_functions,
    touch,
)
from balloon_warp.kernels.memory import byte_in, float_at, float_in, four_in, int_at, int_on_page, triple_at, vector_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.schedules.fixed_point import growth, growth_by_axes, quanta
from balloon_warp.kernels.schedules.launched import Working
from balloon_warp.kernels.schedules.touch_boxes import APART
from balloon_warp.kernels.schedules.touch_search import TOUCHING
from balloon_warp.kernels.schedules.touch_triangles import (
    is_first_of_balloon,
    rows_at,
    side_of,
    triangle_beside,
    triangle_of,
)
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world
from balloon_warp.kernels.traits import Traits

wp.set_module_options(OPTIONS)

UNTOUCHED, TOUCHED, COUNTED = wp.constant(wp.int8(0)), wp.constant(wp.int8(1)), wp.constant(wp.int8(2))
"""what contacts have to do with a particle: nothing; they push or soon will, or it is a corner of what they do to; or
did so in the substep before, of which their number is left"""
PRESS_REGISTERS = 96
"""of a thread: a multiprocessor has 20 warps then, which wait for memory in turns, and 12 without a limit"""


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
        wp.atomic_add(totals, world, axis, corners[0], first)
        wp.atomic_add(totals, world, axis, corners[1], second)
        wp.atomic_add(totals, world, axis, corners[2], third)
        wp.atomic_add(totals, world, axis, particle, -(first + second + third))


@wp.func
def add_contact(working: Working, world: wp.int32, particle: wp.int32, corners: wp.vec3i, counts: wp.vec3):
    """To how many contacts each has: one to the particle, and to a triangle's corners their counts."""
    wp.atomic_add(working.contact_quanta, world, particle, quanta(1.0))
    working.touched[world, particle] = TOUCHED
    for corner in range(3):
        wp.atomic_add(working.contact_quanta, world, corners[corner], quanta(counts[corner]))
        working.touched[world, corners[corner]] = TOUCHED


@wp.func
def take_count(working: Working, world: wp.int32, particle: wp.int32):
    """How many contacts a particle had, and from now on none are counted."""
    mark = working.touched[world, particle]
    if mark == TOUCHED:
        working.contacts[world, particle] = growth(working.contact_quanta, working.contacts_taken, world, particle)
        working.touched[world, particle] = COUNTED
    elif mark == COUNTED:
        working.contacts[world, particle] = 0.0
        working.touched[world, particle] = UNTOUCHED


@wp.func
def forget_count(working: Working, world: wp.int32, particle: wp.int32):
    """As if it had no contacts until now."""
    working.contacts_taken[world, particle] = working.contact_quanta[world, particle]
    working.contacts[world, particle] = 0.0
    working.touched[world, particle] = UNTOUCHED


@wp.kernel(enable_backward=False)
def take_counts(
    threads: wp.int32,
    # in and out
    working: Working,
):
    """Some threads a world."""
    world, thread = wp.tid()
    for particle in range(thread, working.contacts.shape[1], threads):
        take_count(working, world, particle)


@wp.func
def take_pushes(working: Working, world: wp.int32, particle: wp.int32):
    """What contacts do to a particle [N], and nothing is left of it; and how many they are, for the next substep. Most
    are touched by nothing, and cost a GPU the byte that says so."""
    force = wp.vec3()
    mark = byte_in(working.touched, world, particle)
    if mark != UNTOUCHED:
        if mark == TOUCHED:
            force = growth_by_axes(working.touch_quanta, working.touch_taken, world, particle)
        take_count(working, world, particle)
    return force


@cache
def press_function(traits: Traits) -> Any:
    """The function by which a particle touches one triangle."""
    thickness_between, stiffness_between = skin_functions(traits)
    mass_column = traits.columns.places["mass"]
    pair_friction = pair_friction_function(traits)

    @wp.func
    def mass_of(t: Tables, world: wp.int32, balloon: wp.int32):
        """A balloon's [kg]."""
        return t.balloon_numbers[row_of_world(world, t.balloon_numbers.shape[0]), balloon, mass_column]

    @wp.func
    def ease_of_moving(t: Tables, mass_of_balloon: float, particle: wp.int32):
        """1 over its mass [1/kg], 0 if it is fixed."""
        mass = float_at(t.particles.mass_share, particle) * mass_of_balloon
        return wp.where(mass > 0.0, 1.0 / mass, 0.0)

    @wp.func
    def contacts_at(working: Working, world: wp.int32, particle: wp.int32, ease: float):
        """Of a particle; none if it is fixed."""
        return wp.where(ease > 0.0, float_in(working.contacts, world, particle), 0.0)

    @wp.func
    def press(
        t: Tables,
        working: Working,
        world: wp.int32,
        particle: wp.int32,
        candidate: wp.int32,
        place: Place,
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
        only_counts: bool,
        first: bool,
        hold: wp.vec4,
    ):
        """What the particle's hold is then; zero if it does not touch."""
        corners = triple_at(t.touch.triangles, triangle_of(candidate))
        own = int_at(t.particles.balloon, particle)
        other = int_at(t.particles.balloon, corners[0])
        velocity = vector_at(velocities, particle)
        kept = wp.vec4()
        told = Touching()
        told.side = side_of(candidate)
        told.thickness = thickness_between(t, world, own, other)
        told.step_seconds = t.step_seconds
        moving = rows_at(velocities, corners)
        if is_clear(told.side, place, told.thickness, SOON * t.step_seconds, velocity, moving):
            return kept
        places = rows_at(points, corners)
        place = faced(place, places[0], places[1], places[2])
        told.overlap = told.thickness - told.side * place.gap
        its_mass = mass_of(t, world, other)
        told.masses = wp.vec4(
            ease_of_moving(t, mass_of(t, world, own), particle),
            ease_of_moving(t, its_mass, corners[0]),
            ease_of_moving(t, its_mass, corners[1]),
            ease_of_moving(t, its_mass, corners[2]),
        )
        if comes_at(told, place, velocity, moving):
            add_contact(working, world, particle, corners, corner_counts(place, places))
        if told.overlap > 0.0 and wp.max(told.masses) > 0.0 and not only_counts:
            told.stiffness = stiffness_between(t, world, own, other)
            told.friction = pair_friction(t, world, own, other)
            told.first = first
            its_contacts = wp.max(
                wp.max(
                    contacts_at(working, world, corners[0], told.masses[1]),
                    contacts_at(working, world, corners[1], told.masses[2]),
                ),
                contacts_at(working, world, corners[2], told.masses[3]),
            )
            told.crowd = wp.max(
                contacts_at(working, world, particle, told.masses[0]) / float_at(t.touch.crowd, own),
                its_contacts / float_at(t.touch.crowd, other),
            )
            pushes = touch(told, place, hold, velocity, places, moving)
            add_pushes(working.touch_quanta, world, particle, corners, pushes.a, pushes.b, pushes.c)
            kept = pushes.hold
        return kept

    return press


@cache
def pressing_function(traits: Traits) -> Any:
    """The function by which a particle touches the triangles that were found near it."""
    press = press_function(traits)

    @wp.func
    def press_particle(
        t: Tables,
        state: WorldState,
        working: Working,
        world: wp.int32,
        particle: wp.int32,
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
        only_counts: bool,
    ):
        """Of each balloon that it is near to, it touches the nearest triangle.

        Args:
            only_counts: whether nothing is pushed, but only counted what touches.
        """
        count = working.candidate_counts[world, particle]
        point = vector_at(points, particle)
        hold = four_in(state.holds, world, particle)
        after = wp.vec4()
        at = wp.int32(0)
        while at < count:
            nearest = int_on_page(working.candidates, world, at, particle)
            place = triangle_beside(t, points, triangle_of(nearest), point)
            at += 1
            beside = bool(True)
            while at < count and beside:
                candidate = int_on_page(working.candidates, world, at, particle)
                beside = not is_first_of_balloon(candidate)
                if beside:
                    other = triangle_beside(t, points, triangle_of(candidate), point)
                    if is_nearer(other, place):
                        place = other
                        nearest = candidate
                    at += 1
            first = after[3] == 0.0
            kept = press(t, working, world, particle, nearest, place, points, velocities, only_counts, first, hold)
            if first:
                after = kept
        if not only_counts and (count > 0 or hold[3] != 0.0):
            state.holds[world, particle] = after

    return press_particle


@cache
def press_kernel(traits: Traits, fast_math: bool = False) -> Any:
    """The kernel by which particles touch the triangles that were found near them."""
    press_particle = pressing_function(traits)

    @wp.kernel(
        module="unique",
        enable_backward=False,
        cuda_max_registers=PRESS_REGISTERS,
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
        """Some threads a world.

        Args:
            only_counts: whether nothing is pushed, but only counted what touches.
        """
        world, thread = wp.tid()
        if working.near_balloons[world, working.near_balloons.shape[1] - 1] != APART:
            for place in range(thread, working.list_lengths[world, TOUCHING], threads):
                particle = working.particle_lists[world, TOUCHING, place]
                press_particle(t, state, working, world, particle, points[world], velocities[world], only_counts == 1)

    return press_particles

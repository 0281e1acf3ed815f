"""Balloons that touch push each other off, where each piece of a substep is a launch: a particle after the other."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.forces import add_contact, add_pushes, tell_push
from balloon_warp.kernels.contact.search import TOUCHING
from balloon_warp.kernels.contact.triangles import (
    is_first_of_balloon,
    rows_at,
    rows_function,
    side_of,
    triangle_of,
)
from balloon_warp.kernels.loops.friction import friction_of_balloons
from balloon_warp.kernels.loops.meeting import (
    FARTHEST,
    SOON,
    Place,
    Touching,
    comes_at,
    corner_counts,
    faced,
    is_clear,
    is_nearer,
    place_beside,
    skin_functions,
    touch,
)
from balloon_warp.kernels.memory import (
    float_at,
    float_in,
    four_in,
    four_on_page,
    int_at,
    one_of_four,
    triple_at,
    vector_at,
)
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.working import Working

PRESS_REGISTERS = 96
"""Registers of a thread: a multiprocessor then has 20 warps, whose memory latencies overlap, and 12 without a limit"""


@wp.func
def ease_of_moving(t: Tables, mass_of_balloon: float, particle: wp.int32):
    """Return the inverse mass of a particle [1/kg], 0 if it is fixed."""
    mass = float_at(t.particles.mass_share, particle) * mass_of_balloon
    return wp.where(mass > 0.0, 1.0 / mass, 0.0)


@wp.func
def contacts_at(working: Working, world: wp.int32, particle: wp.int32, ease: float):
    """Return the contacts of a particle; none if it is fixed."""
    return wp.where(ease > 0.0, float_in(working.contacts, world, particle), 0.0)


@cache
def press_function(traits: Traits, point_at: Any) -> Any:
    """Make the function by which a particle touches one triangle.

    Args:
        point_at: the function that reads a particle's point.
    """
    rows = rows_function(point_at)
    thickness_between, stiffness_between = skin_functions(traits)
    mass_column = traits.columns.places["mass"]

    @wp.func
    def mass_of(t: Tables, world: wp.int32, balloon: wp.int32):
        """Return a balloon's mass [kg]."""
        return t.balloon_numbers[row_of_world(world, t.balloon_numbers.shape[0]), balloon, mass_column]

    @wp.func
    def press(
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
        places = rows(points, corners)
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
            told.friction = friction_of_balloons(t, world, own, other)
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
            add_pushes(working.push_quanta, world, particle, corners, pushes.a, pushes.b, pushes.c)
            if wp.static(traits.tells_contacts):
                tell_push(working, world, particle, other, -(pushes.a + pushes.b + pushes.c), t.step_seconds)
            kept = pushes.hold
        return kept

    return press


@cache
def pressing_function(traits: Traits, point_at: Any) -> Any:
    """Return the function that presses a particle against the triangles found near it.

    Args:
        point_at: as in `press_function`.
    """
    press, rows = press_function(traits, point_at), rows_function(point_at)

    @wp.func
    def press_particle(
        t: Tables,
        state: WorldState,
        working: Working,
        world: wp.int32,
        particle: wp.int32,
        points: Any,
        velocities: wp.array[wp.vec3],
        only_counts: bool,
    ):
        """Press a particle against the nearest triangle of each balloon that is near.

        Args:
            only_counts: Whether contacts are only counted, without forces.
        """
        count = working.candidate_counts[world, particle]
        point = point_at(points, particle)
        hold = four_in(state.holds, world, particle)
        after = wp.vec4()
        four = wp.vec4i()
        at = wp.int32(0)
        while at < count:
            nearest = wp.int32(-1)
            found = Place()
            found.squared = FARTHEST
            beside = bool(True)
            while at < count and beside:
                if at % 4 == 0:
                    four = four_on_page(working.candidates, world, particle, at)
                candidate = one_of_four(four, at % 4)
                beside = nearest < 0 or not is_first_of_balloon(candidate)
                if beside:
                    corners = rows(points, triple_at(t.touch.triangles, triangle_of(candidate)))
                    place = place_beside(point, corners[0], corners[1], corners[2])
                    if is_nearer(place, found):
                        nearest = candidate
                        found = place
                    at += 1
            if nearest >= 0:  # a point that is not a number is near nothing
                first = after[3] == 0.0
                kept = press(t, working, world, particle, nearest, found, points, velocities, only_counts, first, hold)
                if first:
                    after = kept
        if not only_counts and (count > 0 or hold[3] != 0.0):
            state.holds[world, particle] = after

    return press_particle


@cache
def press_kernel(traits: Traits, fast_math: bool = False) -> Any:
    """Return the kernel that presses particles against the triangles found near them."""
    press_particle = pressing_function(traits, vector_at)

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
        """Press the particles of a world, by some threads a world.

        Args:
            only_counts: Whether contacts are only counted, without forces.
        """
        world, thread = wp.tid()
        for place in range(thread, working.list_lengths[world, TOUCHING], threads):
            particle = working.particle_lists[world, TOUCHING, place]
            press_particle(t, state, working, world, particle, points[world], velocities[world], only_counts == 1)

    return press_particles

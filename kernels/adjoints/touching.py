"""Contacts of balloons backwards: what the forces that particles take are worth, by all that these follow from.

A particle goes through its contacts of a substep as it did forwards, see `contact.response`. What falls to corners of
triangles, and to itself, adds up exactly, see `exact_sums`.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.contact_of_pair import BarsOfContact, WorthOfContact, contact_back, counts_back
from balloon_warp.kernels.adjoints.exact_sums import add_exactly, note_size, parts_per_unit, sum_at
from balloon_warp.kernels.contact.list_lengths import TOUCHING
from balloon_warp.kernels.contact.pairs import (
    contacts_at,
    crowd_of_corners,
    ease_of_moving,
    mass_function,
    pair_functions,
)
from balloon_warp.kernels.contact.response import Found, nearest_function
from balloon_warp.kernels.contact.triangles import rows_at, triangle_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.meeting import SOON, Place, comes_at, faced, is_clear, overlap_of
from balloon_warp.kernels.memory import float_at, four_in, int_at, triple_at, vector_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working

OF_PLACES, OF_VELOCITIES, OF_EASES, OF_CONTACTS = wp.constant(0), wp.constant(1), wp.constant(2), wp.constant(3)
"""Kinds of sums"""
KINDS = 4
EASE, CONTACTS, SUMS = wp.constant(6), wp.constant(7), 8
"""Entries of a particle's sums: after place and velocity its inverse mass, and its contacts in the substep before"""


@wp.struct
class TouchBars:
    """Derivatives by what touching balloons read and find."""

    forces: wp.array2d[wp.vec3]
    """Derivatives by the forces that particles take"""
    holds: wp.array2d[wp.vec4]
    """Derivatives by the state of contacts after a substep, and then before it"""
    counts: wp.array2d[float]
    """Derivatives by the counts of contacts that a substep finds"""
    sums: wp.array3d[wp.int64]
    largest: wp.array2d[float]
    pairs: wp.array3d[wp.vec3]
    """Derivatives by stiffness, friction and thickness between each particle and each balloon, in the frame so far"""
    totals: wp.array3d[wp.vec3d]
    """Sums of these between balloons, since they were last taken"""


@wp.func
def note_sizes(bars: TouchBars, world: wp.int32, found: BarsOfContact, by_contacts: float):
    """Note how large the derivatives of a contact are."""
    places = wp.max(wp.abs(found.point))
    velocities = wp.max(wp.abs(found.velocity))
    for corner in range(3):
        places = wp.max(places, wp.max(wp.abs(found.corners[corner])))
        velocities = wp.max(velocities, wp.max(wp.abs(found.moving[corner])))
    note_size(bars.largest, world, OF_PLACES, places)
    note_size(bars.largest, world, OF_VELOCITIES, velocities)
    note_size(bars.largest, world, OF_EASES, wp.max(wp.abs(found.inputs.masses)))
    note_size(bars.largest, world, OF_CONTACTS, wp.abs(by_contacts))


@wp.func
def add_share(
    bars: TouchBars, world: wp.int32, particle: wp.int32, by_place: wp.vec3, by_velocity: wp.vec3, by_ease: float
):
    """Add what a contact is worth by one of its particles."""
    of_places = parts_per_unit(bars.largest, world, OF_PLACES)
    of_velocities = parts_per_unit(bars.largest, world, OF_VELOCITIES)
    for axis in range(3):
        add_exactly(bars.sums, world, particle, axis, of_places, by_place[axis])
        add_exactly(bars.sums, world, particle, 3 + axis, of_velocities, by_velocity[axis])
    add_exactly(bars.sums, world, particle, EASE, parts_per_unit(bars.largest, world, OF_EASES), by_ease)


@cache
def contact_function(features: Features) -> Any:
    """Return the function that runs the contact of a particle with one triangle backwards."""
    beside, masses_of, pressed = pair_functions(features)

    @wp.func
    def worth_of(bars: TouchBars, world: wp.int32, particle: wp.int32, corners: wp.vec3i):
        """Return what forces and counts of a contact are worth; its hold aside."""
        worth = WorthOfContact()
        own = bars.forces[world, particle]
        worth.a = bars.forces[world, corners[0]] - own
        worth.b = bars.forces[world, corners[1]] - own
        worth.c = bars.forces[world, corners[2]] - own
        return worth

    @wp.func
    def respond_back(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, candidate: wp.int32, near: Place,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], only_counts: bool, first: bool, hold: wp.vec4,
        bars: TouchBars,
    ):  # fmt: skip
        """Return the derivatives by what a contact reads, and its crowd and whether it pushes among them."""
        found = BarsOfContact()
        corners = triple_at(t.touch.triangles, triangle_of(candidate))
        velocity = vector_at(velocities, particle)
        inputs = beside(t, world, particle, candidate, corners)
        moving = rows_at(velocities, corners)
        if is_clear(inputs.side, near, inputs.thickness, SOON * t.step_seconds, velocity, moving):
            return found
        places = rows_at(points, corners)
        place = faced(near, places[0], places[1], places[2])
        inputs.masses = masses_of(t, world, particle, corners)
        counts = wp.vec3()
        if comes_at(inputs, place, velocity, moving):
            counts = wp.vec3(
                bars.counts[world, corners[0]], bars.counts[world, corners[1]], bars.counts[world, corners[2]]
            )
        point = vector_at(points, particle)
        if overlap_of(inputs, place) > 0.0 and wp.max(inputs.masses) > 0.0 and not only_counts:
            worth = worth_of(bars, world, particle, corners)
            worth.counts = counts
            if first:
                worth.hold = bars.holds[world, particle]
            pressing = pressed(t, working, world, particle, corners, inputs, first)
            found = contact_back(point, velocity, places, moving, hold, pressing, worth)
            found.pushes = True
        elif wp.length_sq(counts) > 0.0:
            found = counts_back(point, places, counts)
        return found

    return respond_back


@wp.func
def add_by_contacts(
    t: Tables, working: Working, bars: TouchBars, world: wp.int32, particle: wp.int32, corners: wp.vec3i,
    masses: wp.vec4, by_crowd: float,
):  # fmt: skip
    """Add what the crowd around a contact is worth by the contacts of the busiest of its particles."""
    allowed = float_at(t.touch.crowd, int_at(t.particles.balloon, particle))
    of_other = float_at(t.touch.crowd, int_at(t.particles.balloon, corners[0]))
    most = crowd_of_corners(working, world, corners, masses)
    per_unit = parts_per_unit(bars.largest, world, OF_CONTACTS)
    if contacts_at(working, world, particle, masses[0]) / allowed >= most / of_other:
        add_exactly(bars.sums, world, particle, CONTACTS, per_unit, by_crowd / allowed)
        return
    for corner in range(3):
        if contacts_at(working, world, corners[corner], masses[corner + 1]) == most:
            add_exactly(bars.sums, world, corners[corner], CONTACTS, per_unit, by_crowd / of_other)
            return


@cache
def press_back_kernel(features: Features) -> Any:
    """Return the kernel that runs the contacts of particles backwards."""
    respond_back, nearest_from = contact_function(features), nearest_function(features)
    _, masses_of, _ = pair_functions(features)

    @wp.func
    def add_found(
        t: Tables, working: Working, bars: TouchBars, world: wp.int32, particle: wp.int32, candidate: wp.int32,
        found: BarsOfContact,
    ):  # fmt: skip
        """Add what a contact is worth to the sums of its particles, and of its pair of balloons."""
        corners = triple_at(t.touch.triangles, triangle_of(candidate))
        eases = found.inputs.masses
        add_share(bars, world, particle, found.point, found.velocity, eases[0])
        for corner in range(3):
            add_share(bars, world, corners[corner], found.corners[corner], found.moving[corner], eases[corner + 1])
        if found.pushes:
            masses = masses_of(t, world, particle, corners)
            add_by_contacts(t, working, bars, world, particle, corners, masses, found.inputs.crowd)
            other = int_at(t.particles.balloon, corners[0])
            bars.pairs[world, particle, other] = bars.pairs[world, particle, other] + wp.vec3(
                found.inputs.stiffness, found.inputs.friction, found.inputs.thickness
            )

    @wp.func
    def respond_to_contacts_back(
        t: Tables, working: Working, holds: wp.array2d[wp.vec4], bars: TouchBars, world: wp.int32, particle: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], only_counts: bool, adds: bool,
    ):  # fmt: skip
        """Go through the contacts of a particle."""
        count = working.candidate_counts[world, particle]
        hold = four_in(holds, world, particle)
        by_hold = wp.vec4()
        held = bool(False)
        near = Found()
        while near.end < count:
            near = nearest_from(t, working, world, particle, near.end, count, points)
            if near.nearest >= 0:
                first = not held
                found = respond_back(
                    t, working, world, particle, near.nearest, near.place, points, velocities, only_counts, first,
                    hold, bars,
                )  # fmt: skip
                if found.pushes and first:
                    held = True
                    by_hold = found.hold
                if adds:
                    add_found(t, working, bars, world, particle, near.nearest, found)
                else:
                    note_sizes(bars, world, found, found.inputs.crowd)
        if adds and not only_counts and (count > 0 or hold[3] != 0.0):
            bars.holds[world, particle] = by_hold

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def press_particles_back(
        t: Tables, threads: wp.int32, only_counts: wp.int32, adds: wp.int32, all_points: wp.array2d[wp.vec3],
        all_velocities: wp.array2d[wp.vec3], holds: wp.array2d[wp.vec4], working: Working, bars: TouchBars,
    ):  # fmt: skip
        """Run the contacts of a world's particles backwards, by some threads a world.

        Args:
            adds: Whether derivatives are added; otherwise their sizes are noted.
            holds: State of contacts before the substep.
        """
        world, thread = wp.tid()
        for place in range(thread, working.list_lengths[world, TOUCHING], threads):
            particle = working.particle_lists[world, TOUCHING, place]
            respond_to_contacts_back(
                t, working, holds, bars, world, particle, all_points[world], all_velocities[world], only_counts == 1,
                adds == 1,
            )  # fmt: skip

    return press_particles_back


@cache
def take_back_kernel(features: Features, columns: tuple[int, ...]) -> Any:
    """Return the kernel that hands the sums on to particles.

    Args:
        columns: of the numbers that are derived by.
    """
    column = features.columns.places["mass"]
    place_of_mass = columns.index(column) if column in columns else -1
    mass_of = mass_function(features)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def take_sums(
        t: Tables, bars: TouchBars, point_bars: wp.array2d[wp.vec3], velocity_bars: wp.array2d[wp.vec3],
        number_bars: wp.array3d[float],
    ):  # fmt: skip
        """Add sums to the derivatives of each particle of each world."""
        world, particle = wp.tid()
        by_place = wp.vec3()
        by_velocity = wp.vec3()
        for axis in range(3):
            by_place[axis] = sum_at(bars.sums, bars.largest, world, particle, axis, OF_PLACES)
            by_velocity[axis] = sum_at(bars.sums, bars.largest, world, particle, 3 + axis, OF_VELOCITIES)
        point_bars[world, particle] = point_bars[world, particle] + by_place
        velocity_bars[world, particle] = velocity_bars[world, particle] + by_velocity
        bars.counts[world, particle] = sum_at(bars.sums, bars.largest, world, particle, CONTACTS, OF_CONTACTS)
        if wp.static(place_of_mass >= 0):
            by_ease = sum_at(bars.sums, bars.largest, world, particle, EASE, OF_EASES)
            mass = mass_of(t, world, t.particles.balloon[particle])
            if by_ease != 0.0:
                before = number_bars[world, particle, wp.static(place_of_mass)]
                by_mass = -by_ease * ease_of_moving(t, mass, particle) / mass
                number_bars[world, particle, wp.static(place_of_mass)] = before + by_mass

    return take_sums


@wp.kernel(enable_backward=False, module="unique", module_options=OPTIONS)
def sum_pairs(t: Tables, bars: TouchBars):
    """Add up what pairs of a particle and a balloon have found in a frame, by pairs of balloons; a thread each."""
    world, first, second = wp.tid()
    total = bars.totals[world, first, second]
    for particle in range(t.particles.offsets[first], t.particles.offsets[first + 1]):
        total += wp.vec3d(bars.pairs[world, particle, second])
        bars.pairs[world, particle, second] = wp.vec3()
    bars.totals[world, first, second] = total

"""Sums of derivatives by contacts of balloons, for the particles and pairs of balloons that these follow from.

The parts of corners of triangles, and of particles, add up exactly, see `exact_sums`; `pressing` finds them.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.contact_of_pair import BarsOfContact
from balloon_warp.kernels.adjoints.exact_sums import add_exactly, note_size, parts_per_unit, sum_at
from balloon_warp.kernels.contact.pairs import contacts_at, crowd_of_corners, ease_of_moving, mass_function
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.memory import float_at, four_bytes_in, int_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working

OF_PLACES, OF_VELOCITIES, OF_EASES, OF_CONTACTS = wp.constant(0), wp.constant(1), wp.constant(2), wp.constant(3)
"""Kinds of sums"""
KINDS = 4
UNMARKED, MARKED = wp.constant(wp.int8(0)), wp.constant(wp.int8(1))
EASE, CONTACTS, SUMS = wp.constant(6), wp.constant(7), 8
"""Entries of a particle's sums: after place and velocity its inverse mass, and its contacts in the substep before"""


@wp.struct
class TouchBars:
    """Derivatives by the inputs and results of touching balloons."""

    forces: wp.array2d[wp.vec3]
    """Derivatives by the forces that particles take"""
    holds: wp.array2d[wp.vec4]
    """Derivatives by the state of contacts after a substep, and then before it"""
    counts: wp.array2d[float]
    """Derivatives by the counts of contacts that a substep finds"""
    sums: wp.array3d[wp.int64]
    marks: wp.array2d[wp.int8]
    """1 for particles to which a contact has added, or whose count had a derivative in the substep after; rows are
    whole fours"""
    largest: wp.array2d[float]
    contacts: wp.array[wp.vec3i]
    """Contacts of all worlds that are worth anything: (particle among those of all worlds, candidate, role)"""
    contact_counts: wp.array2d[wp.int32]
    """Length of this list, shape (1, 1)"""
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
    """Add a contact's derivatives by one of its particles."""
    of_places = parts_per_unit(bars.largest, world, OF_PLACES)
    of_velocities = parts_per_unit(bars.largest, world, OF_VELOCITIES)
    for axis in range(3):
        add_exactly(bars.sums, world, particle, axis, of_places, by_place[axis])
        add_exactly(bars.sums, world, particle, 3 + axis, of_velocities, by_velocity[axis])
    add_exactly(bars.sums, world, particle, EASE, parts_per_unit(bars.largest, world, OF_EASES), by_ease)
    bars.marks[world, particle] = MARKED


@wp.func
def add_by_contacts(
    t: Tables, working: Working, bars: TouchBars, world: wp.int32, particle: wp.int32, corners: wp.vec3i,
    masses: wp.vec4, by_crowd: float,
):  # fmt: skip
    """Turn a contact's derivative by its crowd into one by the contacts of the busiest of its particles, and add it."""
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
def take_back_kernel(features: Features, columns: tuple[int, ...]) -> Any:
    """Return the kernel that hands the sums on to particles.

    Args:
        columns: of the numbers that are derived by.
    """
    column = features.columns.places["mass"]
    place_of_mass = columns.index(column) if column in columns else -1
    mass_of = mass_function(features)

    @wp.func
    def take_of(
        t: Tables, bars: TouchBars, world: wp.int32, particle: wp.int32, point_bars: wp.array2d[wp.vec3],
        velocity_bars: wp.array2d[wp.vec3], number_bars: wp.array3d[float],
    ):  # fmt: skip
        """Add the sums of a particle to its derivatives, and clear them."""
        by_place = wp.vec3()
        by_velocity = wp.vec3()
        for axis in range(3):
            by_place[axis] = sum_at(bars.sums, bars.largest, world, particle, axis, OF_PLACES)
            by_velocity[axis] = sum_at(bars.sums, bars.largest, world, particle, 3 + axis, OF_VELOCITIES)
        point_bars[world, particle] = point_bars[world, particle] + by_place
        velocity_bars[world, particle] = velocity_bars[world, particle] + by_velocity
        by_contacts = sum_at(bars.sums, bars.largest, world, particle, CONTACTS, OF_CONTACTS)
        bars.counts[world, particle] = by_contacts
        bars.marks[world, particle] = wp.where(by_contacts != 0.0, MARKED, UNMARKED)
        if wp.static(place_of_mass >= 0):
            by_ease = sum_at(bars.sums, bars.largest, world, particle, EASE, OF_EASES)
            mass = mass_of(t, world, t.particles.balloon[particle])
            if by_ease != 0.0:
                before = number_bars[world, particle, wp.static(place_of_mass)]
                by_mass = -by_ease * ease_of_moving(t, mass, particle) / mass
                number_bars[world, particle, wp.static(place_of_mass)] = before + by_mass
        for entry in range(SUMS):
            bars.sums[world, particle, entry] = wp.int64(0)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def take_sums(
        t: Tables, bars: TouchBars, point_bars: wp.array2d[wp.vec3], velocity_bars: wp.array2d[wp.vec3],
        number_bars: wp.array3d[float],
    ):  # fmt: skip
        """Add sums to the derivatives of particles that are marked; a thread for four, whose marks it reads at once."""
        world, part = wp.tid()
        marks = four_bytes_in(bars.marks, world, 4 * part)
        if marks != 0:
            for place in range(4):
                if marks & (1 << 8 * place) != 0:
                    take_of(t, bars, world, 4 * part + place, point_bars, velocity_bars, number_bars)

    return take_sums


@wp.kernel(enable_backward=False, module="unique", module_options=OPTIONS)
def sum_pairs(t: Tables, bars: TouchBars):
    """Add up the bars of pairs of a particle and a balloon in a frame, by pairs of balloons; a block each."""
    world, first, second, thread = wp.tid()
    total = wp.vec3d()
    for particle in range(t.particles.offsets[first] + thread, t.particles.offsets[first + 1], wp.block_dim()):
        total += wp.vec3d(bars.pairs[world, particle, second])
        bars.pairs[world, particle, second] = wp.vec3()
    found = wp.tile_sum(wp.tile(total, preserve_type=True))[0]
    if thread == 0:
        bars.totals[world, first, second] = bars.totals[world, first, second] + found

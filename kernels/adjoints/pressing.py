"""Adjoint of the contact of balloons: from the bars of the forces on particles to those of all inputs of these forces.

Warp derives one contact of a particle with a triangle of the law's own functions. Frozen is which triangle it is, on
which side of it the particle is, and whether they touch. The parts of corners of triangles, of particles, and of pairs
of balloons add up exactly, see `adjoints.sums`.

A particle goes through its contacts of a substep as it did forwards, see `contact.response`. Few of those that are near
push, and these take hundreds of times as long, so they are listed first: the threads of a warp then all have one.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.adjoints.sums import add_exactly, note_size, parts_per_unit, sum_at
from balloon_warp.kernels.contact.response import RESPONSE_REGISTERS, Found, nearest_function
from balloon_warp.kernels.contact.triangles import (
    contacts_at,
    contacts_of_corners,
    inverse_mass_of,
    mass_function,
    pair_functions,
    rows_at,
    triangle_of,
)
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.contact import (
    SOON,
    Place,
    Touching,
    comes_at,
    corner_counts,
    faced,
    is_clear,
    overlap_of,
    place_beside,
    touch,
)
from balloon_warp.kernels.memory import float_at, four_bytes_in, four_in, int_at, triple_at, vector_at
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.warps import next_place
from balloon_warp.kernels.working import TOUCHING, Working


@wp.struct
class ContactResultBars:
    """Derivatives of the loss by the results of a contact."""

    a: wp.vec3  # by the force on each corner, less that by the force on the particle
    b: wp.vec3
    c: wp.vec3
    hold: wp.vec4
    counts: wp.vec3  # by each corner's share in the count of contacts


@wp.struct
class BarsOfContact:
    """Derivatives of the loss by the inputs of a contact."""

    point: wp.vec3
    velocity: wp.vec3
    corners: wp.mat33
    moving: wp.mat33
    hold: wp.vec4
    inputs: Touching
    pushes: bool  # whether it is one that pushes


@wp.func
def contact_results_pairing(
    point: wp.vec3, velocity: wp.vec3, corners: wp.mat33, moving: wp.mat33, hold: wp.vec4, inputs: Touching,
    result_bars: ContactResultBars,
):  # fmt: skip
    """Pairing of the results of a pushing contact with their bars."""
    beside = place_beside(point, corners[0], corners[1], corners[2])
    place = faced(beside, corners[0], corners[1], corners[2])
    forces = touch(inputs, place, hold, velocity, corners, moving)
    pushes = wp.dot(forces.a, result_bars.a) + wp.dot(forces.b, result_bars.b) + wp.dot(forces.c, result_bars.c)
    return pushes + wp.dot(forces.hold, result_bars.hold) + wp.dot(corner_counts(place, corners), result_bars.counts)


@wp.func
def counts_pairing(point: wp.vec3, corners: wp.mat33, result_bars: wp.vec3):
    """Pairing of the corners' contact counts with their bars."""
    beside = place_beside(point, corners[0], corners[1], corners[2])
    place = faced(beside, corners[0], corners[1], corners[2])
    return wp.dot(corner_counts(place, corners), result_bars)


@wp.func
def contact_back(
    point: wp.vec3, velocity: wp.vec3, corners: wp.mat33, moving: wp.mat33, hold: wp.vec4, inputs: Touching,
    result_bars: ContactResultBars,
):  # fmt: skip
    """Adjoint of a pushing contact: bars of its inputs."""
    bars = BarsOfContact()
    by_point, by_velocity, by_corners, by_moving, by_hold, by_inputs, _bars = wp.grad(contact_results_pairing)(
        point, velocity, corners, moving, hold, inputs, result_bars
    )
    bars.point = by_point
    bars.velocity = by_velocity
    bars.corners = by_corners
    bars.moving = by_moving
    bars.hold = by_hold
    bars.inputs = by_inputs
    return bars


@wp.func
def counts_back(point: wp.vec3, corners: wp.mat33, result_bars: wp.vec3):
    """Adjoint of the contact count of a near pair: bars of its inputs."""
    bars = BarsOfContact()
    by_point, by_corners, _bars = wp.grad(counts_pairing)(point, corners, result_bars)
    bars.point = by_point
    bars.corners = by_corners
    return bars


OF_PLACES, OF_VELOCITIES, OF_INVERSE_MASSES, OF_CONTACTS = (
    wp.constant(0),
    wp.constant(1),
    wp.constant(2),
    wp.constant(3),
)
"""Kinds of sums"""
KINDS = 4
UNMARKED, MARKED = wp.constant(wp.int8(0)), wp.constant(wp.int8(1))
INVERSE_MASS, CONTACTS, SUMS = wp.constant(6), wp.constant(7), 8
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
    """Contacts of all worlds with nonzero bars: (particle among those of all worlds, candidate, role)"""
    contact_counts: wp.array2d[wp.int32]
    """Length of this list, shape (1, 1)"""
    pairs: wp.array3d[wp.vec3]
    """Derivatives by stiffness, friction and thickness between each particle and each balloon, in the frame so far"""
    totals: wp.array3d[wp.vec3d]
    """Sums of these between balloons, since they were last taken"""


@wp.func
def note_sizes(bars: TouchBars, world: wp.int32, found: BarsOfContact, by_contacts: float):
    """Record the magnitude of a contact's bars."""
    places = wp.max(wp.abs(found.point))
    velocities = wp.max(wp.abs(found.velocity))
    for corner in range(3):
        places = wp.max(places, wp.max(wp.abs(found.corners[corner])))
        velocities = wp.max(velocities, wp.max(wp.abs(found.moving[corner])))
    note_size(bars.largest, world, OF_PLACES, places)
    note_size(bars.largest, world, OF_VELOCITIES, velocities)
    note_size(bars.largest, world, OF_INVERSE_MASSES, wp.max(wp.abs(found.inputs.masses)))
    note_size(bars.largest, world, OF_CONTACTS, wp.abs(by_contacts))


@wp.func
def add_share(
    bars: TouchBars, world: wp.int32, particle: wp.int32, by_place: wp.vec3, by_velocity: wp.vec3,
    by_inverse_mass: float,
):  # fmt: skip
    """Add a contact's derivatives by one of its particles."""
    of_places = parts_per_unit(bars.largest, world, OF_PLACES)
    of_velocities = parts_per_unit(bars.largest, world, OF_VELOCITIES)
    for axis in range(3):
        add_exactly(bars.sums, world, particle, axis, of_places, by_place[axis])
        add_exactly(bars.sums, world, particle, 3 + axis, of_velocities, by_velocity[axis])
    add_exactly(
        bars.sums, world, particle, INVERSE_MASS, parts_per_unit(bars.largest, world, OF_INVERSE_MASSES),
        by_inverse_mass,
    )  # fmt: skip
    bars.marks[world, particle] = MARKED


@wp.func
def add_by_contacts(
    t: Tables, working: Working, bars: TouchBars, world: wp.int32, particle: wp.int32, corners: wp.vec3i,
    masses: wp.vec4, by_contact_count: float,
):  # fmt: skip
    """Add the bar of a contact's count to that of the busiest of its particles."""
    allowed = float_at(t.touch.crowd, int_at(t.particles.balloon, particle))
    of_other = float_at(t.touch.crowd, int_at(t.particles.balloon, corners[0]))
    most = contacts_of_corners(working, world, corners, masses)
    per_unit = parts_per_unit(bars.largest, world, OF_CONTACTS)
    if contacts_at(working, world, particle, masses[0]) / allowed >= most / of_other:
        add_exactly(bars.sums, world, particle, CONTACTS, per_unit, by_contact_count / allowed)
        return
    for corner in range(3):
        if contacts_at(working, world, corners[corner], masses[corner + 1]) == most:
            add_exactly(bars.sums, world, corners[corner], CONTACTS, per_unit, by_contact_count / of_other)
            return


@cache
def take_back_kernel(features: Features, columns: tuple[int, ...]) -> Any:
    """Kernel that adds the sums to the bars of particles.

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
            by_inverse_mass = sum_at(bars.sums, bars.largest, world, particle, INVERSE_MASS, OF_INVERSE_MASSES)
            mass = mass_of(t, world, t.particles.balloon[particle])
            if by_inverse_mass != 0.0:
                before = number_bars[world, particle, wp.static(place_of_mass)]
                by_mass = -by_inverse_mass * inverse_mass_of(t, mass, particle) / mass
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


CLEAR, COUNTS, PUSHES, PUSHES_FIRST = (wp.constant(role) for role in range(4))
"""Roles of a contact: it has no bars, only its count has one, or it pushes; the first that does so has
the particle's hold"""


@wp.kernel(enable_backward=False, module="unique", module_options=OPTIONS)
def keep_search(
    working: Working, counts: wp.array2d[wp.int32], candidates: wp.array3d[wp.int32], lists: wp.array3d[wp.int32],
    lengths: wp.array2d[wp.int32],
):  # fmt: skip
    """Keep the results of a search: of each particle no more than it has."""
    world, particle = wp.tid()
    count = working.candidate_counts[world, particle]
    counts[world, particle] = count
    for place in range(count):
        candidates[world, particle, place] = working.candidates[world, particle, place]
    if particle < working.list_lengths[world, TOUCHING]:
        lists[world, TOUCHING, particle] = working.particle_lists[world, TOUCHING, particle]
    if particle == 0:
        for which in range(lengths.shape[1]):
            lengths[world, which] = working.list_lengths[world, which]


@wp.kernel(enable_backward=False, module="unique", module_options=OPTIONS)
def keep_holds(threads: wp.int32, working: Working, holds: wp.array2d[wp.vec4], kept_holds: wp.array2d[wp.vec4]):
    """Keep the state of contacts of those particles that may have any, by some threads a world."""
    world, thread = wp.tid()
    for place in range(thread, working.list_lengths[world, TOUCHING], threads):
        particle = working.particle_lists[world, TOUCHING, place]
        kept_holds[world, particle] = holds[world, particle]


@cache
def role_function(features: Features) -> Any:
    """Role function of a particle's contact with one triangle."""
    beside, masses_of, _ = pair_functions(features)

    @wp.func
    def role_of(
        t: Tables, bars: TouchBars, world: wp.int32, particle: wp.int32, candidate: wp.int32, near: Place,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], only_counts: bool,
    ):  # fmt: skip
        corners = triple_at(t.touch.triangles, triangle_of(candidate))
        velocity = vector_at(velocities, particle)
        inputs = beside(t, world, particle, candidate, corners)
        moving = rows_at(velocities, corners)
        if is_clear(inputs.side, near, inputs.thickness, SOON * t.step_seconds, velocity, moving):
            return CLEAR
        places = rows_at(points, corners)
        place = faced(near, places[0], places[1], places[2])
        if overlap_of(inputs, place) > 0.0 and not only_counts:
            if wp.max(masses_of(t, world, particle, corners)) > 0.0:
                return PUSHES
        if comes_at(inputs, place, velocity, moving):
            for corner in range(3):
                if bars.counts[world, corners[corner]] != 0.0:
                    return COUNTS
        return CLEAR

    return role_of


@cache
def list_contacts_kernel(features: Features, fast_math: bool = False) -> Any:
    """Kernel that lists the contacts with nonzero bars."""
    role_of, nearest_from = role_function(features), nearest_function(features)

    @wp.func
    def list_contacts_of(
        t: Tables, working: Working, holds: wp.array2d[wp.vec4], bars: TouchBars, world: wp.int32, particle: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], only_counts: bool,
    ):  # fmt: skip
        count = working.candidate_counts[world, particle]
        first = bool(True)
        near = Found()
        while near.end < count:
            near = nearest_from(t, working, world, particle, near.end, count, points)
            if near.nearest >= 0:
                role = role_of(
                    t, bars, world, particle, near.nearest, near.place, points, velocities, only_counts
                )  # fmt: skip
                if role == PUSHES and first:
                    role = PUSHES_FIRST
                    first = False
                if role != CLEAR:
                    place = next_place(bars.contact_counts, 0, 0)
                    bars.contacts[place] = wp.vec3i(world * points.shape[0] + particle, near.nearest, role)
        if first and not only_counts and (count > 0 or four_in(holds, world, particle)[3] != 0.0):
            bars.holds[world, particle] = wp.vec4()

    @wp.kernel(
        module="unique", enable_backward=False, cuda_max_registers=RESPONSE_REGISTERS,
        module_options={**OPTIONS, "fast_math": fast_math},
    )  # fmt: skip
    def list_contacts(
        t: Tables, threads: wp.int32, only_counts: wp.int32, all_points: wp.array2d[wp.vec3],
        all_velocities: wp.array2d[wp.vec3], holds: wp.array2d[wp.vec4], working: Working, bars: TouchBars,
    ):  # fmt: skip
        """List the contacts of a world's particles, by some threads a world; in any order.

        Args:
            holds: State of contacts before the substep.
        """
        world, thread = wp.tid()
        for place in range(thread, working.list_lengths[world, TOUCHING], threads):
            particle = working.particle_lists[world, TOUCHING, place]
            list_contacts_of(
                t, working, holds, bars, world, particle, all_points[world], all_velocities[world], only_counts == 1
            )

    return list_contacts


@wp.func
def contact_pairing(bars: TouchBars, world: wp.int32, particle: wp.int32, corners: wp.vec3i):
    """Bars of a contact's forces and counts, without that of its hold."""
    result_bars = ContactResultBars()
    own = bars.forces[world, particle]
    result_bars.a = bars.forces[world, corners[0]] - own
    result_bars.b = bars.forces[world, corners[1]] - own
    result_bars.c = bars.forces[world, corners[2]] - own
    result_bars.counts = wp.vec3(
        bars.counts[world, corners[0]], bars.counts[world, corners[1]], bars.counts[world, corners[2]]
    )
    return result_bars


@cache
def contact_function(features: Features) -> Any:
    """Adjoint of the contact of a particle with one triangle."""
    beside, masses_of, pressed = pair_functions(features)

    @wp.func
    def respond_back(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, candidate: wp.int32, role: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], hold: wp.vec4, bars: TouchBars,
    ):  # fmt: skip
        """Bars of a contact's inputs, with its contact count and whether it pushes."""
        corners = triple_at(t.touch.triangles, triangle_of(candidate))
        point = vector_at(points, particle)
        places = rows_at(points, corners)
        result_bars = contact_pairing(bars, world, particle, corners)
        found = BarsOfContact()
        if role == COUNTS:
            found = counts_back(point, places, result_bars.counts)
        else:
            if role == PUSHES_FIRST:
                result_bars.hold = bars.holds[world, particle]
            inputs = beside(t, world, particle, candidate, corners)
            inputs.masses = masses_of(t, world, particle, corners)
            pressing = pressed(t, working, world, particle, corners, inputs, role == PUSHES_FIRST)
            moving = rows_at(velocities, corners)
            found = contact_back(point, vector_at(velocities, particle), places, moving, hold, pressing, result_bars)
            found.pushes = True
        return found

    return respond_back


@cache
def press_back_kernel(features: Features, fast_math: bool = False) -> Any:
    """Backward kernel of contacts."""
    respond_back = contact_function(features)
    _, masses_of, _ = pair_functions(features)

    @wp.func
    def add_found(
        t: Tables, working: Working, bars: TouchBars, world: wp.int32, particle: wp.int32, candidate: wp.int32,
        found: BarsOfContact,
    ):  # fmt: skip
        """Add the derivatives by a contact to the sums of its particles, and of its pair of balloons."""
        corners = triple_at(t.touch.triangles, triangle_of(candidate))
        inverse_masses = found.inputs.masses
        add_share(bars, world, particle, found.point, found.velocity, inverse_masses[0])
        for corner in range(3):
            add_share(
                bars, world, corners[corner], found.corners[corner], found.moving[corner], inverse_masses[corner + 1]
            )
        if found.pushes:
            masses = masses_of(t, world, particle, corners)
            add_by_contacts(t, working, bars, world, particle, corners, masses, found.inputs.crowd)
            other = int_at(t.particles.balloon, corners[0])
            bars.pairs[world, particle, other] = bars.pairs[world, particle, other] + wp.vec3(
                found.inputs.stiffness, found.inputs.friction, found.inputs.thickness
            )

    @wp.kernel(module="unique", enable_backward=False, module_options={**OPTIONS, "fast_math": fast_math})
    def press_particles_back(
        t: Tables, threads: wp.int32, adds: wp.int32, all_points: wp.array2d[wp.vec3],
        all_velocities: wp.array2d[wp.vec3], holds: wp.array2d[wp.vec4], working: Working, bars: TouchBars,
    ):  # fmt: skip
        """Run listed contacts backwards, by some threads for all worlds.

        Args:
            adds: Whether derivatives are added; otherwise their sizes are noted.
            holds: State of contacts before the substep.
        """
        thread = wp.tid()
        for place in range(thread, bars.contact_counts[0, 0], threads):
            contact = bars.contacts[place]
            world = contact[0] // all_points.shape[1]
            particle = contact[0] % all_points.shape[1]
            found = respond_back(
                t, working, world, particle, contact[1], contact[2], all_points[world], all_velocities[world],
                four_in(holds, world, particle), bars,
            )  # fmt: skip
            if adds == 1:
                add_found(t, working, bars, world, particle, contact[1], found)
                if contact[2] == PUSHES_FIRST:
                    bars.holds[world, particle] = found.hold
            else:
                note_sizes(bars, world, found, found.inputs.crowd)

    return press_particles_back

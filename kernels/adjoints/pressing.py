"""Contacts of balloons backwards: from the bars of the forces on particles to those of all inputs of these forces.

A particle goes through its contacts of a substep as it did forwards, see `contact.response`. Few of those that are near
push, and these take hundreds of times as long, so they are listed first: the threads of a warp then all have one.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.contact_of_pair import BarsOfContact, WorthOfContact, contact_back, counts_back
from balloon_warp.kernels.adjoints.touching import TouchBars, add_by_contacts, add_share, note_sizes
from balloon_warp.kernels.contact.list_lengths import TOUCHING
from balloon_warp.kernels.contact.pairs import pair_functions
from balloon_warp.kernels.contact.response import RESPONSE_REGISTERS, Found, nearest_function
from balloon_warp.kernels.contact.triangles import rows_at, triangle_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.meeting import SOON, Place, comes_at, faced, is_clear, overlap_of
from balloon_warp.kernels.memory import four_in, int_at, triple_at, vector_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.warps import next_place
from balloon_warp.kernels.working import Working

CLEAR, COUNTS, PUSHES, PUSHES_FIRST = (wp.constant(role) for role in range(4))
"""Roles of a contact: it is worth nothing, only its count is worth something, or it pushes; the first that does so has
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
    """Return the function that tells the role of a contact of a particle with one triangle."""
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
    """Return the kernel that lists the contacts that are worth anything."""
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


@cache
def contact_function(features: Features) -> Any:
    """Return the function that runs the contact of a particle with one triangle backwards."""
    beside, masses_of, pressed = pair_functions(features)

    @wp.func
    def worth_of(bars: TouchBars, world: wp.int32, particle: wp.int32, corners: wp.vec3i):
        """Return the bars of a contact's forces and counts; its hold aside."""
        worth = WorthOfContact()
        own = bars.forces[world, particle]
        worth.a = bars.forces[world, corners[0]] - own
        worth.b = bars.forces[world, corners[1]] - own
        worth.c = bars.forces[world, corners[2]] - own
        worth.counts = wp.vec3(
            bars.counts[world, corners[0]], bars.counts[world, corners[1]], bars.counts[world, corners[2]]
        )
        return worth

    @wp.func
    def respond_back(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, candidate: wp.int32, role: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], hold: wp.vec4, bars: TouchBars,
    ):  # fmt: skip
        """Return the derivatives by a contact's inputs, and its crowd and whether it pushes among them."""
        corners = triple_at(t.touch.triangles, triangle_of(candidate))
        point = vector_at(points, particle)
        places = rows_at(points, corners)
        worth = worth_of(bars, world, particle, corners)
        found = BarsOfContact()
        if role == COUNTS:
            found = counts_back(point, places, worth.counts)
        else:
            if role == PUSHES_FIRST:
                worth.hold = bars.holds[world, particle]
            inputs = beside(t, world, particle, candidate, corners)
            inputs.masses = masses_of(t, world, particle, corners)
            pressing = pressed(t, working, world, particle, corners, inputs, role == PUSHES_FIRST)
            moving = rows_at(velocities, corners)
            found = contact_back(point, vector_at(velocities, particle), places, moving, hold, pressing, worth)
            found.pushes = True
        return found

    return respond_back


@cache
def press_back_kernel(features: Features, fast_math: bool = False) -> Any:
    """Return the kernel that runs contacts backwards."""
    respond_back = contact_function(features)
    _, masses_of, _ = pair_functions(features)

    @wp.func
    def add_found(
        t: Tables, working: Working, bars: TouchBars, world: wp.int32, particle: wp.int32, candidate: wp.int32,
        found: BarsOfContact,
    ):  # fmt: skip
        """Add the derivatives by a contact to the sums of its particles, and of its pair of balloons."""
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

"""Lists of the particles of a world that search for triangles, and of those that have found some.

With lists adjacent threads all have work. The order in a list does not matter.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.boxes import (
    ALONE,
    KNOWN,
    LOOKS,
    has_strayed,
    is_searched,
    nearing_function,
    pad_function,
)
from balloon_warp.kernels.contact.clearances import is_clear_of_own
from balloon_warp.kernels.contact.eight_boxes import first_of, lining_function, nearing_ones
from balloon_warp.kernels.contact.list_lengths import LOOKING, PAIRS, TOUCHING
from balloon_warp.kernels.contact.lists import finding_functions
from balloon_warp.kernels.contact.room import OF_PAIRS, OF_TRIANGLES, ask_for_room
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import next_place
from balloon_warp.kernels.working import Working

FIND_REGISTERS = 64
"""Registers of a searching thread, so that more threads overlap their memory latencies"""


@wp.func
def put_on_list(working: Working, world: wp.int32, which: wp.int32, particle: wp.int32):
    """Append a particle to a list, by any thread in any order."""
    place = next_place(working.list_lengths, world, which)
    working.particle_lists[world, which, place] = particle


@wp.func
def list_beside_edges(working: Working, world: wp.int32, particle: wp.int32, count: wp.int32):
    """List a particle and its triangles among the pairs of edges: its own number below -1, and places in its list."""
    begin = wp.atomic_add(working.list_lengths, world, PAIRS, count)
    fit = wp.clamp(working.edge_pairs.shape[1] - begin, 0, count)
    for at in range(fit):
        working.edge_pairs[world, begin + at] = wp.vec3i(-1 - particle, at, 0)
    if fit < count:
        ask_for_room(working, world, OF_PAIRS, begin + count, count - fit)


@cache
def neighbor_function(features: Features) -> Any:
    """Return the function that goes on to the next balloon that a particle may touch."""
    is_nearing = nearing_function(features)

    @wp.func
    def next_neighbor(
        t: Tables, working: Working, world: wp.int32, balloon: wp.int32, begin: wp.int32, point: wp.vec3,
        velocity: wp.vec3,
    ):  # fmt: skip
        """Return the next balloon, or -1, and the place after it among the neighbors."""
        place = begin
        other = wp.int32(-1)
        while place < working.neighbor_counts[world, balloon] and other < 0:
            nearby = working.neighbors[world, balloon, place]
            if is_nearing(t, working, world, balloon, nearby, point, velocity):
                other = nearby
            place += 1
        return other, place

    return next_neighbor


@wp.func
def next_of_eight(
    t: Tables, working: Working, world: wp.int32, balloon: wp.int32, begin: wp.int32, point: wp.vec3, velocity: wp.vec3
):  # fmt: skip
    """Return the same by eight boxes at a time, see `contact.eight_boxes`."""
    place = begin
    count = working.neighbor_counts[world, balloon]
    while place < count:
        near = nearing_ones(t, working, world, place, point, velocity) >> (place & 7)
        if near != 0:
            place = wp.min(place + first_of(near), count - 1)  # also where places are no numbers, in a blow-up
            return working.neighbors[world, balloon, place], place + 1
        place = ((place >> 3) + 1) << 3
    return -1, count


@cache
def looking_kernel(features: Features, eight: bool = False) -> Any:
    """Return the kernel that finds the particles that search.

    Args:
        eight: whether one thread compares boxes eight at a time.
    """
    is_nearing = nearing_function(features)
    line_up_neighbors = lining_function(features)
    pad_between = pad_function(features)

    @wp.func
    def looks(
        t: Tables, state: WorldState, working: Working, world: wp.int32, particle: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3], is_clear: bool,
    ):  # fmt: skip
        """Return whether a particle may touch a balloon, or has touched one until now.

        Args:
            is_clear: Whether it cannot touch its own.
        """
        balloon = t.particles.balloon[particle]
        used = t.faces.particle_offsets[particle + 1] > t.faces.particle_offsets[particle]
        if used and working.near_balloons[world, balloon] != ALONE:
            point = vector_at(points, particle)
            velocity = vector_at(velocities, particle)
            if wp.static(eight):
                place = wp.int32(0)
                while place < working.neighbor_counts[world, balloon]:
                    other, place = next_of_eight(t, working, world, balloon, place, point, velocity)
                    if other >= 0 and not (is_clear and other == balloon):
                        return True
            else:
                for place in range(working.neighbor_counts[world, balloon]):
                    other = working.neighbors[world, balloon, place]
                    if not (is_clear and other == balloon):
                        if is_nearing(t, working, world, balloon, other, point, velocity):
                            return True
        return state.holds[world, particle][3] != 0.0

    @wp.func
    def note_looking(
        t: Tables, state: WorldState, working: Working, world: wp.int32, particle: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Append a particle that searches to its list, and store its position if the last search is outdated."""
        balloon = t.particles.balloon[particle]
        is_clear = bool(False)
        if wp.static(features.touches_itself):
            moved = wp.length(points[particle] - working.sought[world, particle])
            speed = wp.length(velocities[particle])
            pad = pad_between(t, world, balloon, balloon)
            is_clear = is_clear_of_own(t, working, world, balloon, particle, working.clearances, moved, speed, pad)
        if has_strayed(working, world, balloon):
            working.sought[world, particle] = points[particle]
        if working.near_balloons[world, balloon] != KNOWN:
            working.candidate_counts[world, particle] = 0
        if looks(t, state, working, world, particle, points, velocities, is_clear):
            put_on_list(working, world, LOOKING, particle)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def find_looking(
        # model
        t: Tables,
        threads: wp.int32,
        # state in
        state: WorldState,
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        working: Working,
    ):
        """Find the particles that search, by some threads a world."""
        world, thread = wp.tid()
        if is_searched(working, world):
            for particle in range(thread, points.shape[1], threads):
                if wp.static(eight):
                    line_up_neighbors(t, working, world, particle, particle - 1)
                note_looking(t, state, working, world, particle, points[world], velocities[world])

    return find_looking


@cache
def find_kernel(features: Features, fast_math: bool = False, eight: bool = False) -> Any:
    """Return the kernel that finds the triangles that each searching particle may touch.

    Args:
        eight: whether one thread compares boxes eight at a time, which are lined up before.
    """
    find_of_balloon = finding_functions(features, eight)
    next_neighbor = next_of_eight if eight else neighbor_function(features)
    line_up_neighbors = lining_function(features)

    @wp.func
    def list_triangles(
        t: Tables,
        state: WorldState,
        working: Working,
        world: wp.int32,
        particle: wp.int32,
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):
        """Find the triangles of all balloons that a particle may touch, if its current ones do not suffice.

        The search extends to the depth of other balloons where a particle may have started, or was pressed in so far;
        not wherever it has come behind a surface, as in crumpled skin, out of which there is no way.
        """
        balloon = t.particles.balloon[particle]
        point = vector_at(points, particle)
        velocity = vector_at(velocities, particle)
        count = working.candidate_counts[world, particle]
        if working.near_balloons[world, balloon] != KNOWN:
            may_be_deep = state.deep[world, particle] == wp.int8(1)
            state.deep[world, particle] = wp.int8(0)
            if working.near_balloons[world, balloon] == LOOKS:
                place = wp.int32(0)
                while place < working.neighbor_counts[world, balloon]:
                    other, place = next_neighbor(t, working, world, balloon, place, point, velocity)
                    if other >= 0:
                        count = find_of_balloon(
                            t, state, working, world, particle, balloon, other, points, velocities, may_be_deep, count
                        )
        room = working.candidates.shape[2]
        if count > room:
            ask_for_room(working, world, OF_TRIANGLES, count, count - room)
            count = room
        working.candidate_counts[world, particle] = count
        if count > 0 or state.holds[world, particle][3] != 0.0:
            put_on_list(working, world, TOUCHING, particle)
        if wp.static(features.edges_meet):
            if working.list_lengths[world, PAIRS] > 0:  # edges are near, so that particles beside them are looked at
                list_beside_edges(working, world, particle, count)

    @wp.kernel(
        module="unique",
        enable_backward=False,
        cuda_max_registers=FIND_REGISTERS,
        module_options={**OPTIONS, "fast_math": fast_math},
    )
    def find_near_triangles(
        # model
        t: Tables,
        threads: wp.int32,
        # state in and out
        state: WorldState,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        working: Working,
    ):
        """Find the triangles near each particle, by some threads a world."""
        world, thread = wp.tid()
        if is_searched(working, world):
            for place in range(thread, working.list_lengths[world, LOOKING], threads):
                particle = working.particle_lists[world, LOOKING, place]
                if wp.static(eight):
                    before = working.particle_lists[world, LOOKING, wp.max(place - 1, 0)]
                    line_up_neighbors(t, working, world, particle, wp.where(place > 0, before, -1))
                list_triangles(t, state, working, world, particle, points[world], velocities[world])

    return find_near_triangles

"""The `block` schedule for worlds of at most 1,024 particles: all but the points stays in registers.

A thread has one particle, or two, which then share what a thread does for itself. What bounds it, for a particle and
substep with 12 springs: 12 loads and a store of 3 words from shared memory, 39 wavefronts a warp without bank
conflicts; and 14 instructions a spring and 23 more, 191 in all. A multiprocessor does one wavefront and four
instructions of a warp in a cycle, so that issue bounds it first, at 48 cycles for 32 particles: 132 multiprocessors at
1.98 GHz make 1.75e11 particle-substeps a second.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.loops.areas import volume_origin
from balloon_warp.kernels.loops.net_force import scalar_loops
from balloon_warp.kernels.memory import in_tile, put_in_tile
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.schedules.block.board import board_of
from balloon_warp.kernels.schedules.block.ends import stretch_function
from balloon_warp.kernels.schedules.block.films import films_of
from balloon_warp.kernels.schedules.block.gas import gas_sums
from balloon_warp.kernels.schedules.block.memory import (
    BlockMemory,
    Layout,
    Seat,
    at_substep,
    beginning_of_frame,
    frame_functions,
    member_functions,
    take_seat,
)
from balloon_warp.kernels.schedules.block.pieces import pieces_of
from balloon_warp.kernels.schedules.block.press import presses_of
from balloon_warp.kernels.schedules.block.refresh import refresh_of
from balloon_warp.kernels.loops.slots import SlotTable, slot_functions
from balloon_warp.kernels.schedules.block.state import state_functions
from balloon_warp.kernels.schedules.block.together import together_of
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import block_barrier


@cache
def resident_kernel(traits: Traits, layout: Layout) -> Any:
    """A kernel for just what a scene has."""
    threads, two, face_capacity = layout.threads, layout.two, layout.faces
    area_capacity = 1 if layout.film and not layout.film.areas else face_capacity
    Center, Area = (wp.vec4, wp.vec2) if layout.film else (wp.vec3, wp.vec3)  # noqa: N806 - or what `film_places` says
    capacity = threads * (2 if two else 1)
    odd_capacity = 1 if layout.one_tile else capacity
    Springs, read_springs, pull_of_springs, area_in_ring, facing_in_ring = slot_functions(  # noqa: N806 - a type
        traits, layout.kind_slots, layout.rings, by_place=True
    )
    films = films_of(traits, layout, Springs, read_springs, pull_of_springs) if layout.film else None
    area_vector, facing = area_in_ring if layout.rings else None, facing_in_ring if traits.aims_on_the_way else None
    if films:
        Member, seat_member, seat_beside = member_functions(traits, films.held, films.read)  # noqa: N806 - a type
        loops = scalar_loops(traits._replace(membranes=()), in_tile, films.pull, films.area_vector)
    else:
        Member, seat_member, seat_beside = member_functions(traits, Springs, read_springs)  # noqa: N806 - a type
        loops = scalar_loops(traits, in_tile, pull_of_springs, area_vector, facing)
    board, gas, refresh = board_of(traits, layout), gas_sums(traits, layout), refresh_of(traits, layout)
    pieces = pieces_of(traits, loops, board, gas, refresh, Member, layout)
    together = together_of(traits, pieces, board, gas, refresh, Member, layout)
    begins = beginning_of_frame(traits)
    take_place, end_member = state_functions(traits, layout, Member)
    is_due, squared_speed, ends_well, count_frame = frame_functions(traits)
    presses = presses_of(traits, layout) if traits.touches else None
    stretch = stretch_function(traits, layout, films, Member) if films else None

    @wp.func
    def show_member(state: WorldState, seat: Seat, member: Member, velocities: wp.array[wp.vec3]):
        """Where others look for it in the next substep, beside the tile."""
        if wp.static(traits.looks_at_velocities or traits.touches):
            if member.active:
                velocities[member.own.number] = member.velocity

    @wp.func
    def watch(t: Tables, place: wp.int32, member: Member, source: Any):
        """How fast a particle was."""
        squared = squared_speed(t, in_tile(source, place), member.point, member.velocity)
        member.fastest = wp.max(member.fastest, squared)
        return member

    @wp.func
    def substep(
        t: Tables,
        state: WorldState,
        memory: BlockMemory,
        seat: Seat,
        mine: Member,
        also: Member,
        source: Any,
        target: Any,
        velocities: wp.array[wp.vec3],
        new_velocities: wp.array[wp.vec3],
        centers: Any,
        areas: Any,
    ):
        """One substep, from one tile of points to the other; of faces centers and areas, or what `films` says."""
        if wp.static(traits.touches):
            presses.press(t, state, memory, seat, source, source, velocities)
        area = float(0.0)
        if wp.static(traits.aims and traits.fresh_normals):
            area, aimed, other_aimed = together.aim(t, seat, mine, also, source, centers, areas)
            mine = aimed
            also = other_aimed
        if wp.static(films is not None):
            stretched, other_stretched = stretch(t, seat, mine, also, source, velocities, centers, areas)
            mine = stretched
            also = other_stretched
        if wp.static(traits.spheres > 0 and not board.rolls_by_warps):
            board.roll(t, seat.spins, seat.world, seat.thread, seat.substep, seat.time + t.step_seconds)
            block_barrier()
        if wp.static(traits.gas_changes):
            mine = pieces.fill(t, seat, mine)
            if wp.static(two):
                also = pieces.fill(t, seat, also)
        force, pulled = pieces.pull(t, seat, source, velocities, mine, area)
        mine = pulled
        other_force = wp.vec3()
        if wp.static(two):
            pull, other_pulled = pieces.pull(t, seat, source, velocities, also, area)
            other_force = pull
            also = other_pulled
        if wp.static(traits.touches):
            force += presses.take(memory, seat, mine)
            if wp.static(two):
                other_force += presses.take(memory, seat, also)
        if wp.static(traits.gas):
            mine.free_velocity = pieces.free(t, seat, mine, force)
            if wp.static(two):
                also.free_velocity = pieces.free(t, seat, also, other_force)
            loaded, also_loaded = together.swell(t, state, seat, mine, also, source)
            mine = loaded
            also = also_loaded
            mine = pieces.push(t, seat, mine, mine.free_velocity, wp.vec3())
            if wp.static(two):
                also = pieces.push(t, seat, also, also.free_velocity, wp.vec3())
        else:
            mine = pieces.push(t, seat, mine, mine.velocity, force)
            if wp.static(two):
                also = pieces.push(t, seat, also, also.velocity, other_force)
        if wp.static(not traits.corrected):
            left, other_left = together.leave(t, seat, mine, also, target, new_velocities)
            mine = left
            also = other_left
        put_in_tile(target, seat.thread, mine.point)
        if wp.static(two):
            put_in_tile(target, seat.thread + threads, also.point)
        if wp.static(traits.corrected):
            left, other_left = together.correct(t, seat, mine, also, target, new_velocities)
            mine = left
            also = other_left
        show_member(state, seat, mine, new_velocities)
        if wp.static(two):
            show_member(state, seat, also, new_velocities)
        if wp.static(traits.frames == "free"):
            mine = watch(t, seat.thread, mine, source)
            if wp.static(two):
                also = watch(t, seat.thread + threads, also, source)
        block_barrier()
        return mine, also

    @wp.func
    def go_through(
        t: Tables,
        state: WorldState,
        memory: BlockMemory,
        seat: Seat,
        mine: Member,
        also: Member,
        even: Any,
        odd: Any,
        seen: wp.array[wp.vec3],
        shown: wp.array[wp.vec3],
        centers: Any,
        areas: Any,
    ):
        """All substeps of the frame that begins at the seat's time."""
        if wp.static(layout.one_tile):
            for number in range(t.substeps):
                now = at_substep(t, seat, seat.time, number)
                moved, beside = substep(t, state, memory, now, mine, also, even, even, seen, seen, centers, areas)
                mine = moved
                also = beside
        else:
            for pair in range(t.substeps // 2):
                now = at_substep(t, seat, seat.time, 2 * pair)
                first, second = substep(t, state, memory, now, mine, also, even, odd, seen, shown, centers, areas)
                then = at_substep(t, seat, seat.time, 2 * pair + 1)
                third, fourth = substep(t, state, memory, then, first, second, odd, even, shown, seen, centers, areas)
                mine = third
                also = fourth
            if wp.static(layout.odd_substeps):
                last = at_substep(t, seat, seat.time, t.substeps - 1)
                fifth, sixth = substep(t, state, memory, last, mine, also, even, odd, seen, shown, centers, areas)
                mine = fifth
                also = sixth
        return mine, also

    @wp.func
    def end_pair(
        t: Tables, state: WorldState, memory: BlockMemory, seat: Seat, mine: Member, also: Member, points: Any
    ):
        """Of all that a thread has."""
        end_member(t, state, memory, seat, seat.thread, mine, points)
        if wp.static(two):
            end_member(t, state, memory, seat, seat.thread + threads, also, points)

    @wp.kernel(
        module="unique",
        enable_backward=False,
        cuda_max_registers=layout.registers,
        module_options={**OPTIONS, "fast_math": True, "max_unroll": 128},
    )
    def advance_resident(
        # model
        t: Tables,
        slots: SlotTable,
        # state in and out
        state: WorldState,
        memory: BlockMemory,
    ):
        """A block a world, one or two particles a thread: one frame."""
        world, thread = wp.tid()
        count_frame(state, world, thread)
        if not is_due(memory, world):
            return
        even = wp.tile_empty(shape=capacity, dtype=wp.vec3, storage="shared")
        odd = wp.tile_empty(shape=odd_capacity, dtype=wp.vec3, storage="shared")
        centers = wp.tile_empty(shape=face_capacity, dtype=Center, storage="shared")
        areas = wp.tile_empty(shape=area_capacity, dtype=Area, storage="shared")
        seat = take_seat(state, world, thread)
        seat.time = begins(t, memory)
        velocities = state.velocities[world]
        other_velocities = state.velocities[world]
        if wp.static(traits.looks_at_velocities):
            other_velocities = memory.other_velocities[world]
            if wp.static(traits.frames == "free"):  # the state's stay as they were until all has gone well
                velocities = memory.velocities[world]
        if wp.static(traits.spheres > 0):
            board.begin(t, state, world, thread)
        if wp.static(traits.gas):
            seat.origin = volume_origin(t, 0)
            gas.begin(t, state, seat, seat.time)
        if wp.static(films is not None):
            films.begin(t, seat, centers, areas)
        mine = take_place(state, memory, seat, seat_member(t, slots, state, seat, thread), thread, even, velocities)
        also = Member()
        if wp.static(two):
            beside = seat_beside(t, slots, state, seat, thread + threads, mine)
            also = take_place(state, memory, seat, beside, thread + threads, even, velocities)
        block_barrier()
        if wp.static(traits.gas and not traits.gas_changes):
            mine = pieces.fill(t, seat, mine)
            if wp.static(two):
                also = pieces.fill(t, seat, also)
        if wp.static(traits.aims and not traits.fresh_normals):
            _area, aimed, other_aimed = together.aim(t, seat, mine, also, even, centers, areas)
            mine = aimed
            also = other_aimed
        moved, beside_it = go_through(
            t, state, memory, seat, mine, also, even, odd, velocities, other_velocities, centers, areas
        )
        mine = moved
        also = beside_it
        if ends_well(t, memory, world, thread, wp.max(mine.fastest, also.fastest)):
            if wp.static(layout.odd_substeps):
                end_pair(t, state, memory, seat, mine, also, odd)
            else:
                end_pair(t, state, memory, seat, mine, also, even)
            if wp.static(traits.spheres > 0):
                board.end(t, state, world, thread, t.substeps - 1)

    return advance_resident

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

from balloon_warp.kernels.loops.net_force import scalar_loops
from balloon_warp.kernels.measure.health import is_past, look_at_particle
from balloon_warp.kernels.memory import in_tile, put_in_tile
from balloon_warp.kernels.schedules.block_board import board_of
from balloon_warp.kernels.schedules.block_correct import correcting
from balloon_warp.kernels.schedules.block_gas import gas_sums
from balloon_warp.kernels.schedules.block_memory import (
    BlockMemory,
    Layout,
    Seat,
    at_substep,
    beginning_of_frame,
    frame_functions,
    member_functions,
    pair_functions,
)
from balloon_warp.kernels.schedules.block_pieces import pieces_of
from balloon_warp.kernels.schedules.block_press import presses_of
from balloon_warp.kernels.schedules.block_refresh import refresh_of
from balloon_warp.kernels.schedules.block_springs import SlotTable, slot_functions
from balloon_warp.kernels.schedules.block_touch import one_of_two, touching
from balloon_warp.kernels.schedules.free_frames import note_hurry
from balloon_warp.kernels.schedules.warps import any_in_block, block_barrier
from balloon_warp.kernels.substep import volume_origin
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits


@cache
def resident_kernel(traits: Traits, layout: Layout) -> Any:
    """A kernel for just what a scene has."""
    threads, two, face_capacity = layout.threads, layout.two, layout.faces
    capacity = threads * (2 if two else 1)
    Springs, read_springs, pull_of_springs, area_in_ring, facing_in_ring = slot_functions(  # noqa: N806 - a type
        traits, layout.kind_slots
    )
    Member, seat_member, seat_beside = member_functions(traits, Springs, read_springs)  # noqa: N806 - a type
    loops = scalar_loops(
        traits,
        in_tile,
        pull_of_springs,
        area_in_ring if layout.rings else None,
        facing_in_ring if traits.aims_on_the_way else None,
    )
    board, gas, refresh = board_of(traits, layout), gas_sums(traits, layout), refresh_of(traits, layout)
    pieces = pieces_of(traits, loops, board, gas, refresh, Member, layout)
    correct = correcting(traits, layout)
    touch = touching(traits, board, one_of_two, layout)
    put_members, get_members = pair_functions(layout)
    begins = beginning_of_frame(traits)
    is_due, count_frame = frame_functions(traits)
    presses = presses_of(traits, layout) if traits.touches else None

    @wp.func
    def take_place(
        state: WorldState, seat: Seat, member: Member, place: wp.int32, points: Any, velocities: wp.array[wp.vec3]
    ):
        """A particle with a frame's beginning; its point into the tile."""
        member.load = state.inflation_loads[seat.world, member.own.balloon]
        member.point = state.points[seat.world, member.own.number]
        member.velocity = velocities[member.own.number]
        put_in_tile(points, place, member.point)
        return member

    @wp.func
    def aim_together(t: Tables, seat: Seat, mine: Member, also: Member, points: Any, centers: Any, areas: Any):
        """Faces are measured, and unless aims come on the way, particles aim. The area of the balloon, if there is
        one."""
        refresh.measure(t, seat, points, centers, areas)
        area = float(0.0)
        if wp.static(traits.balloons == 1 or not traits.aims_on_the_way):
            area = refresh.area(mine.own.balloon)
        if wp.static(not traits.aims_on_the_way):
            mine.aim = refresh.aim(t, points, centers, areas, mine.own.number, mine.point, area)
            if wp.static(two):
                also.aim = refresh.aim(
                    t, points, centers, areas, also.own.number, also.point, refresh.area(also.own.balloon)
                )
        return area, mine, also

    @wp.func
    def swell_together(t: Tables, state: WorldState, seat: Seat, mine: Member, also: Member, points: Any):
        """The pressures, once all particles have their free velocities."""
        gas.clear(seat)
        origin = points[volume_origin(t, mine.own.balloon)]
        part = pieces.swell(t, seat, mine, origin)
        if wp.static(two and traits.balloons == 1):
            part += pieces.swell(t, seat, also, origin)
        gas.add(seat, mine.own.balloon, part, False)
        if wp.static(two and traits.balloons > 1):
            other_origin = points[volume_origin(t, also.own.balloon)]
            gas.add(seat, also.own.balloon, pieces.swell(t, seat, also, other_origin), True)
        block_barrier()
        gas.find_loads(t, state, seat)
        mine.load = gas.own_load(t, state, seat, mine)
        if wp.static(two and traits.balloons == 1):
            also.load = mine.load
        elif wp.static(two):
            also.load = gas.own_load(t, state, seat, also)
        gas.pump(t, state, seat)
        return mine, also

    @wp.func
    def leave_together(t: Tables, seat: Seat, mine: Member, also: Member, target: Any, velocities: wp.array[wp.vec3]):
        """Out of obstacles."""
        if wp.static(traits.penalties):
            left, other_left = pieces.leave(t, seat, mine, also)
            mine = left
            also = other_left
        if wp.static(traits.impulses):
            near = pieces.is_near(t, seat, mine, also)
            if any_in_block(near):
                put_members(seat, mine, also, target, velocities)
                touch(t, seat, near, wp.vec2(mine.inertia, also.inertia), target, velocities)
                met, other_met = get_members(seat, mine, also, target, velocities)
                mine = met
                also = other_met
        if wp.static(traits.stands):
            mine = pieces.stand(t, seat, mine)
            if wp.static(two):
                also = pieces.stand(t, seat, also)
        return mine, also

    @wp.func
    def correct_together(t: Tables, seat: Seat, mine: Member, also: Member, target: Any, velocities: wp.array[wp.vec3]):
        """Springs shortened in the target, then out of obstacles."""
        put_members(seat, mine, also, target, velocities)
        block_barrier()
        correct(t, seat, target, velocities)
        back, other_back = get_members(seat, mine, also, target, velocities)
        left, other_left = leave_together(t, seat, back, other_back, target, velocities)
        put_in_tile(target, seat.thread, left.point)
        if wp.static(two):
            put_in_tile(target, seat.thread + threads, other_left.point)
        return left, other_left

    @wp.func
    def show_member(state: WorldState, seat: Seat, member: Member, velocities: wp.array[wp.vec3]):
        """Where others look for it in the next substep, beside the tile."""
        if wp.static(traits.looks_at_velocities or traits.touches):
            if member.active:
                velocities[member.own.number] = member.velocity
                if wp.static(traits.touches):
                    state.points[seat.world, member.own.number] = member.point

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
        """One substep, from one tile of points to the other."""
        if wp.static(traits.touches):
            presses.press(t, state, memory, seat, velocities)
        area = float(0.0)
        if wp.static(traits.aims and traits.fresh_normals):
            area, aimed, other_aimed = aim_together(t, seat, mine, also, source, centers, areas)
            mine = aimed
            also = other_aimed
        if wp.static(traits.spheres > 0 and not board.rolls_by_warps):
            board.roll(t, seat.world, seat.thread, seat.substep, seat.time + t.step_seconds)
            block_barrier()
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
            loaded, also_loaded = swell_together(t, state, seat, mine, also, source)
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
            left, other_left = leave_together(t, seat, mine, also, target, new_velocities)
            mine = left
            also = other_left
        put_in_tile(target, seat.thread, mine.point)
        if wp.static(two):
            put_in_tile(target, seat.thread + threads, also.point)
        if wp.static(traits.corrected):
            left, other_left = correct_together(t, seat, mine, also, target, new_velocities)
            mine = left
            also = other_left
        show_member(state, seat, mine, new_velocities)
        if wp.static(two):
            show_member(state, seat, also, new_velocities)
        if wp.static(traits.frames == "free"):
            mine.farthest = wp.max(mine.farthest, wp.length_sq(mine.point - in_tile(source, seat.thread)))
            if wp.static(two):
                also.farthest = wp.max(also.farthest, wp.length_sq(also.point - in_tile(source, seat.thread + threads)))
        block_barrier()
        return mine, also

    @wp.func
    def end_member(t: Tables, state: WorldState, seat: Seat, place: wp.int32, member: Member, points: Any):
        """What a frame ends with; what the substeps do not need is read again, so that it takes no register."""
        if place < seat.count:
            state.points[seat.world, place] = member.point
            state.velocities[seat.world, place] = member.velocity
            if is_past(member.point, t.health.near):  # few are
                look_at_particle(
                    t.health, state.first_bad, seat.world, place, place, t.particles.balloon[place],
                    t.particles.mass_share[place], points,
                )  # fmt: skip

    @wp.kernel(
        module="unique",
        enable_backward=False,
        cuda_max_registers=layout.registers,
        module_options={"fast_math": True, "max_unroll": 128},
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
        if not is_due(memory, world):
            return
        even = wp.tile_empty(shape=capacity, dtype=wp.vec3, storage="shared")
        odd = wp.tile_empty(shape=capacity, dtype=wp.vec3, storage="shared")
        centers = wp.tile_empty(shape=face_capacity, dtype=wp.vec3, storage="shared")
        areas = wp.tile_empty(shape=face_capacity, dtype=wp.vec3, storage="shared")
        seat = Seat()
        seat.world = world
        seat.thread = thread
        seat.count = state.points.shape[1]
        frame_begin = begins(t, memory)
        velocities = state.velocities[world]
        other_velocities = state.velocities[world]
        if wp.static(traits.looks_at_velocities):
            other_velocities = memory.other_velocities[world]
        if wp.static(traits.spheres > 0):
            board.begin(t, state, world, thread)
        if wp.static(traits.gas):
            gas.begin(t, state, seat)
        mine = take_place(state, seat, seat_member(t, slots, state, seat, thread), thread, even, velocities)
        also = Member()
        if wp.static(two):
            beside = seat_beside(t, slots, state, seat, thread + threads, mine)
            also = take_place(state, seat, beside, thread + threads, even, velocities)
        block_barrier()
        if wp.static(traits.aims and not traits.fresh_normals):
            _area, aimed, other_aimed = aim_together(t, seat, mine, also, even, centers, areas)
            mine = aimed
            also = other_aimed
        for pair in range(t.substeps // 2):
            now = at_substep(t, seat, frame_begin, 2 * pair)
            first, second = substep(
                t, state, memory, now, mine, also, even, odd, velocities, other_velocities, centers, areas
            )
            then = at_substep(t, seat, frame_begin, 2 * pair + 1)
            third, fourth = substep(
                t, state, memory, then, first, second, odd, even, other_velocities, velocities, centers, areas
            )
            mine = third
            also = fourth
        if wp.static(layout.odd_substeps):
            last = at_substep(t, seat, frame_begin, t.substeps - 1)
            fifth, sixth = substep(
                t, state, memory, last, mine, also, even, odd, velocities, other_velocities, centers, areas
            )
            mine = fifth
            also = sixth
            end_member(t, state, seat, thread, mine, odd)
            if wp.static(two):
                end_member(t, state, seat, thread + threads, also, odd)
        else:
            end_member(t, state, seat, thread, mine, even)
            if wp.static(two):
                end_member(t, state, seat, thread + threads, also, even)
        if wp.static(traits.spheres > 0):
            board.end(t, state, world, thread, t.substeps - 1)
        if wp.static(traits.frames == "free"):
            note_hurry(memory.free, world, wp.max(mine.farthest, also.farthest), t.substeps)
        count_frame(state, world, thread)

    return advance_resident

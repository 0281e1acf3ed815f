"""The `block` schedule for worlds of any size that fits in shared memory: a thread goes through many particles, whose
springs it reads every substep."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.gas import Swelling
from balloon_warp.kernels.loops.areas import volume_origin
from balloon_warp.kernels.loops.net_force import scalar_loops
from balloon_warp.kernels.loops.springs import spring_loop
from balloon_warp.kernels.memory import in_tile, put_in_tile
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.schedules.block.board import board_of
from balloon_warp.kernels.schedules.block.compaction import later_of
from balloon_warp.kernels.schedules.block.correct import correcting
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
    no_springs,
    take_seat,
    velocity_functions,
)
from balloon_warp.kernels.schedules.block.pieces import pieces_of
from balloon_warp.kernels.schedules.block.press import presses_of
from balloon_warp.kernels.schedules.block.refresh import refresh_of
from balloon_warp.kernels.schedules.block.solids import solids_of
from balloon_warp.kernels.schedules.block.turns import leaving_in_turns, touching_in_turns, turns_of
from balloon_warp.kernels.schedules.block.wear import wear_in_block
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import block_barrier


@cache
def streaming_kernel(traits: Traits, layout: Layout) -> Any:
    """A kernel for worlds of up to so many particles; on the CPU, a block is one thread."""
    films = films_of(traits, layout, wp.int32, no_springs, spring_loop(traits, in_tile)) if layout.film else None
    held, read_held = (films.held, films.read) if films else (wp.int32, no_springs)
    Member, seat_member, seat_beside = member_functions(traits, held, read_held)  # noqa: N806 - a type
    board, gas = board_of(traits, layout), gas_sums(traits, layout)
    refresh = refresh_of(traits, layout)
    if films:
        loops = scalar_loops(traits._replace(membranes=()), in_tile, films.pull, films.area_vector)
    else:
        loops = scalar_loops(traits, in_tile, aims=traits.aims_on_the_way)
    pieces = pieces_of(traits, loops, board, gas, refresh, Member, layout)
    turns = turns_of(traits, pieces, gas, Member, seat_member, seat_beside, layout)
    correct = correcting(traits, layout)
    begins = beginning_of_frame(traits)
    is_due, squared_speed, ends_well, count_frame = frame_functions(traits)
    presses = presses_of(traits, layout) if traits.touches else None
    wear = wear_in_block(traits) if traits.softens else None
    velocity_at, put_velocity = velocity_functions(layout)
    threads, capacity = layout.threads, layout.capacity
    leave_all = leaving_in_turns(traits, turns, Member)
    touch_all = touching_in_turns(traits, pieces, board, turns, seat_member, layout)
    solids = solids_of(traits, board, gas)
    later = later_of(traits, seat_member, layout) if traits.may_put_off else None

    @wp.func
    def refresh_aims(t: Tables, memory: BlockMemory, seat: Seat, points: Any):
        """Faces are measured, and unless aims come on the way, those of all particles go into memory. The area of the
        balloon, if there is one."""
        centers = memory.face_centers[seat.world]
        area_vectors = memory.face_area_vectors[seat.world]
        refresh.measure(t, seat, points, centers, area_vectors)
        area = float(0.0)
        if wp.static(traits.balloons == 1):
            area = refresh.area(0)
        if wp.static(not traits.aims_on_the_way):
            for particle in range(seat.thread, seat.count, wp.block_dim()):
                if wp.static(traits.balloons > 1):
                    area = refresh.area(t.particles.balloon[particle])
                memory.aims[seat.world, particle] = refresh.aim(
                    t, points, centers, area_vectors, particle, points[particle], area
                )
        return area

    @wp.func
    def pull(t: Tables, memory: BlockMemory, seat: Seat, source: Any, velocities: Any, member: Member, area: float):
        """All forces on a particle but the inflation, and the particle with what came on the way."""
        if wp.static(films is not None):
            pulls = memory.film_pulls[seat.world]
            member.springs = films.take(t, seat, member.own.number, member.springs, pulls, pulls)
        force, pulled = pieces.pull(t, seat, source, velocities, member, area)
        if wp.static(traits.touches and not traits.pushes_come_last):
            force += presses.take(memory, seat, pulled)
        turns.keep_aim(memory, seat, pulled)
        return force, pulled

    @wp.func
    def pull_and_swell(
        t: Tables,
        state: WorldState,
        memory: BlockMemory,
        seat: Seat,
        first: Member,
        area: float,
        rounds: wp.int32,
        source: Any,
        target: Any,
        velocities: Any,
        new_velocities: Any,
    ):
        """Every particle as far as its free velocity, which takes the place of the new one; then the balloons'
        pressures. Its area vector waits where its new point will be."""
        gas.clear(seat)
        total = Swelling()
        for turn in range(rounds):
            seated = turns.member(t, state, memory, seat, first, turn, source, velocities)
            force, member = pull(t, memory, seat, source, velocities, seated, area)
            member.free_velocity = pieces.free(t, seat, member, force)
            if member.active:
                put_velocity(new_velocities, member.own.number, member.free_velocity)
                put_in_tile(target, member.own.number, member.area_vector)
            part = pieces.swell(t, seat, member, source[volume_origin(t, member.own.balloon)])
            if wp.static(traits.balloons == 1):
                total += part
            else:
                gas.add(seat, member.own.balloon, part, True)
        if wp.static(traits.balloons == 1):
            gas.add(seat, 0, total, False)
        block_barrier()
        gas.find_loads(t, state, seat)
        gas.pump(t, state, seat)

    @wp.func
    def push_and_move(
        t: Tables,
        state: WorldState,
        memory: BlockMemory,
        seat: Seat,
        first: Member,
        area: float,
        rounds: wp.int32,
        source: Any,
        target: Any,
        velocities: Any,
        new_velocities: Any,
    ):
        """Every particle through the rest of the substep; the highest speed of this thread's, squared [m^2/s^2]."""
        fastest = float(0.0)
        for turn in range(rounds):
            member = turns.member(t, state, memory, seat, first, turn, source, velocities)
            if wp.static(traits.gas):
                member.area_vector = in_tile(target, member.own.number)
                free = velocity_at(new_velocities, member.own.number)
                member = pieces.push(t, seat, member, free, wp.vec3())
            else:
                force, pulled = pull(t, memory, seat, source, velocities, member, area)
                velocity = member.velocity
                if wp.static(traits.pushes_come_last and later is None):
                    velocity = presses.push(t, memory, seat, member, velocity)
                member = pieces.push(t, seat, pulled, velocity, force)
            if wp.static(traits.keeps_inflations and traits.pressures):
                if member.active:
                    memory.inflations[seat.world, member.own.number] = member.push
            if wp.static(later is not None):
                member = later.note(t, memory, seat, member, in_tile(source, member.own.number))
            elif wp.static(traits.leaves_at_once):
                member = turns.leave(t, seat, member)
            if wp.static(traits.frames == "free"):
                before = in_tile(source, member.own.number)
                fastest = wp.max(fastest, squared_speed(t, before, member.point, member.velocity))
            turns.put(seat, member, target, new_velocities)
        return fastest

    @wp.func
    def substep(
        t: Tables,
        state: WorldState,
        memory: BlockMemory,
        seat: Seat,
        first: Member,
        source: Any,
        target: Any,
        velocities: Any,
        new_velocities: Any,
    ):
        """From one tile of points to the other; the highest speed of this thread's, squared [m^2/s^2]."""
        if wp.static(wear is not None):
            wear.find(t, state, memory, seat, source)
        if wp.static(films is not None):
            pulls = memory.film_pulls[seat.world]
            films.stretch(t, seat, first.own.n, first.springs, source, velocities, pulls, pulls)
        rounds = (seat.count + threads - 1) // threads
        area = float(0.0)
        if wp.static(traits.aims):
            if wp.static(traits.fresh_normals) or seat.substep == 0:
                area = refresh_aims(t, memory, seat, source)
        if wp.static(traits.spheres > 0):
            board.roll(t, seat.spins, seat.world, seat.thread, seat.substep, seat.time + t.step_seconds)
            block_barrier()
        if wp.static(traits.bodies > 0):
            solids.tumble(t, state, memory, seat)
        if wp.static(traits.gas):
            pull_and_swell(t, state, memory, seat, first, area, rounds, source, target, velocities, new_velocities)
        fastest = push_and_move(t, state, memory, seat, first, area, rounds, source, target, velocities, new_velocities)
        if wp.static(later is not None):
            later.end(t, state, memory, seat, target, new_velocities)
        if wp.static(traits.corrected):
            block_barrier()
            correct(t, seat, target, new_velocities)
        if wp.static(traits.impulses):
            touch_all(t, state, seat, rounds, target, new_velocities)
        if wp.static(traits.leaves_together):
            leave_all(t, state, memory, seat, first, rounds, target, new_velocities)
        if wp.static(traits.meets_solids):
            solids.meet(t, state, memory, seat, source, target, new_velocities)
        block_barrier()
        return fastest

    options = {**OPTIONS, "fast_math": True}

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=layout.registers, module_options=options)
    def advance_streaming(
        # model
        t: Tables,
        # state in and out
        state: WorldState,
        memory: BlockMemory,
    ):
        """A block a world: one frame."""
        world, thread = wp.tid()
        count_frame(state, world, thread)
        if not is_due(memory, world):
            return
        even = wp.tile_empty(shape=capacity, dtype=wp.vec3, storage="shared")
        odd = wp.tile_empty(shape=capacity, dtype=wp.vec3, storage="shared")
        seat = take_seat(state, world, thread)
        frame_begin = begins(t, memory)
        if wp.static(layout.fast_velocities):
            velocities = wp.tile_empty(shape=capacity, dtype=wp.vec3, storage="shared")
            other_velocities = velocities
        else:
            velocities = memory.velocities[world]
            other_velocities = memory.velocities[world]
            if wp.static(traits.keeps_velocities):
                other_velocities = memory.other_velocities[world]
        if wp.static(later is not None):
            later.begin(seat)
        if wp.static(traits.spheres > 0):
            board.begin(t, state, world, thread)
        if wp.static(traits.gas):
            gas.begin(t, state, seat, frame_begin)
        for particle in range(thread, seat.count, wp.block_dim()):
            number = memory.numbers[particle]
            put_in_tile(even, particle, state.points[world, number])
            put_velocity(velocities, particle, state.velocities[world, number])
        first = seat_member(t, 0, state, seat, 0)
        block_barrier()
        fastest = float(0.0)
        if wp.static(traits.touches):
            for number in range(t.substeps):
                now = at_substep(t, seat, frame_begin, number)
                old_velocities = velocities
                if wp.static(traits.keeps_velocities):
                    if number % 2 == 1:
                        old_velocities = other_velocities
                # not in `substep`, which is there twice: the code would be longer than what a GPU keeps at hand
                presses.press(t, state, memory, now, even, odd, old_velocities)
                speed = float(0.0)
                if number % 2 == 0:
                    speed = substep(t, state, memory, now, first, even, odd, velocities, other_velocities)
                else:
                    speed = substep(t, state, memory, now, first, odd, even, other_velocities, velocities)
                fastest = wp.max(fastest, speed)
        else:
            for pair in range(t.substeps // 2):
                now = at_substep(t, seat, frame_begin, 2 * pair)
                speed = substep(t, state, memory, now, first, even, odd, velocities, other_velocities)
                then = at_substep(t, seat, frame_begin, 2 * pair + 1)
                next_speed = substep(t, state, memory, then, first, odd, even, other_velocities, velocities)
                fastest = wp.max(fastest, wp.max(speed, next_speed))
            if wp.static(layout.odd_substeps):
                last = at_substep(t, seat, frame_begin, t.substeps - 1)
                last_speed = substep(t, state, memory, last, first, even, odd, velocities, other_velocities)
                fastest = wp.max(fastest, last_speed)
        if ends_well(t, memory, world, thread, fastest):
            if wp.static(layout.odd_substeps):
                turns.end(t, state, memory, seat, odd, other_velocities)
            else:
                turns.end(t, state, memory, seat, even, velocities)
            if wp.static(wear is not None):
                wear.end(t, state, memory, seat)
            if wp.static(traits.spheres > 0):
                board.end(t, state, world, thread, t.substeps - 1)

    return advance_streaming

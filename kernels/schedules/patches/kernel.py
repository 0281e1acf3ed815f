"""Patches: a world cut into parts that blocks of a GPU move at once, for all of a frame. For few large worlds.

Each particle stays in the registers of a thread, and the points of its patch in the block's shared memory, with a rim
of those outside that its springs and faces lead to. After each substep a block tells others where those of its
particles are that they need, and hears where its rim is. So a substep takes no launch. All blocks must run at once: no
more are launched than the multiprocessors have registers for.
"""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.loops.net_force import scalar_loops
from balloon_warp.kernels.memory import in_tile, put_in_tile
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.schedules.block.board import board_of
from balloon_warp.kernels.schedules.block.memory import Layout, Seat, at_substep, member_functions, take_seat
from balloon_warp.kernels.schedules.block.pieces import pieces_of
from balloon_warp.kernels.loops.slots import SlotTable, slot_functions
from balloon_warp.kernels.schedules.patches.aims import patch_aims
from balloon_warp.kernels.schedules.patches.gas import patch_gas
from balloon_warp.kernels.schedules.patches.halo import hear, tell
from balloon_warp.kernels.schedules.patches.memory import PatchMemory, PatchSeat, PatchTable
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import block_barrier


class PatchLayout(NamedTuple):
    """How patches lie on blocks."""

    threads: int
    """of a block: the most particles of a patch"""
    rim: int
    """the most of its rim"""
    registers: int
    """of a thread"""
    kind_slots: tuple[int, int, int]
    """the most springs of each kind at a particle"""
    rings: bool
    """area vectors come of the ring of springs around each particle"""


@cache
def patch_kernel(traits: Traits, layout: PatchLayout) -> Any:
    """A kernel for just what a scene has."""
    threads, capacity = layout.threads, layout.threads + layout.rim
    in_block = Layout(threads, capacity, resident=True, kind_slots=layout.kind_slots, rings=layout.rings)
    Springs, read_springs, pull_of_springs, area_in_ring, facing_in_ring = slot_functions(  # noqa: N806 - a type
        traits, layout.kind_slots
    )
    Member, seat_member, _ = member_functions(traits, Springs, read_springs)  # noqa: N806 - a type
    facing = facing_in_ring if traits.aims_on_the_way else None
    loops = scalar_loops(traits, in_tile, pull_of_springs, area_in_ring if layout.rings else None, facing)
    warps = layout.threads // 32
    gas, aims, board = patch_gas(traits, warps), patch_aims(warps), board_of(traits, in_block)
    pieces = pieces_of(traits, loops, board, gas, aims, Member, in_block)

    @wp.func
    def take_patch(
        patches: PatchTable, first: wp.int32, count: wp.int32, slot: wp.int32, patch: wp.int32, thread: wp.int32
    ):
        """As a frame begins."""
        seat = PatchSeat()
        seat.world = first + slot
        seat.slot = slot
        seat.slots = count
        seat.patches = patches.balloons.shape[0]
        seat.patch = patch
        seat.thread = thread
        seat.rim = patches.rims[patch, thread]
        number = patches.numbers[patch, thread]
        if number < patches.in_rims.shape[0]:
            seat.told = patches.in_rims[number] != 0
        seat.begin = patches.firsts[patches.balloons[patch]]
        seat.count = patches.firsts[patches.balloons[patch] + 1] - seat.begin
        return seat

    @wp.func
    def take_place(state: WorldState, memory: PatchMemory, seat: PatchSeat, member: Member):
        """A particle with a frame's beginning."""
        member.load = state.inflation_loads[seat.world, member.own.balloon]
        member.point = state.points[seat.world, member.own.number]
        member.velocity = state.velocities[seat.world, member.own.number]
        if wp.static(traits.aims and not traits.fresh_normals):
            member.aim = memory.aims[seat.world, member.own.number]
        return member

    @wp.func
    def exchange(memory: PatchMemory, seat: PatchSeat, now: Seat, member: Member, tile: Any):
        """After a substep: where particles are in rims, to the blocks around and from them."""
        number = now.substep
        row = ((number & 1) * seat.slots + seat.slot) * now.count
        if seat.told:
            tell(memory.points, row + member.own.number, number + 1, member.point)
        point = hear(memory.points, row + seat.rim, number + 1, seat.rim >= 0)
        if seat.rim >= 0:
            put_in_tile(tile, threads + seat.thread, point)

    @wp.func
    def substep(
        t: Tables,
        state: WorldState,
        memory: PatchMemory,
        patches: PatchTable,
        seat: PatchSeat,
        member: Member,
        frame_begin: float,
        number: wp.int32,
        tile: Any,
    ):
        """One substep. With a tile to read and one to write there would be two of these in a loop, which takes three
        times as long to compile."""
        now = at_substep(t, take_seat(state, seat.world, seat.thread), frame_begin, number)
        area = float(0.0)
        if wp.static(traits.aims_on_the_way):
            area = aims.measure(patches, memory, seat, number, tile)
        force, pulled = pieces.pull(t, now, tile, state.velocities[seat.world], member, area)
        member = pulled
        if wp.static(traits.gas):
            member.free_velocity = pieces.free(t, now, member, force)
            part = pieces.swell(t, now, member, in_tile(tile, patches.origins[seat.patch]))
            member.load = gas.find_load(t, state, memory, seat, now, member, part)
            member = pieces.push(t, now, member, member.free_velocity, wp.vec3())
        else:
            member = pieces.push(t, now, member, member.velocity, force)
        if wp.static(traits.stands):
            member = pieces.stand(t, now, member)
        block_barrier()
        put_in_tile(tile, seat.thread, member.point)
        if number + 1 < t.substeps:
            exchange(memory, seat, now, member, tile)
        block_barrier()
        return member

    @wp.kernel(
        module="unique",
        enable_backward=False,
        cuda_max_registers=layout.registers,
        module_options={**OPTIONS, "fast_math": True, "max_unroll": 128},
    )
    def advance_patches(
        # model
        t: Tables,
        slots: SlotTable,
        patches: PatchTable,
        first_world: wp.int32,
        worlds_at_work: wp.int32,
        # state in and out
        state: WorldState,
        memory: PatchMemory,
    ):
        """A block a patch, a thread a particle: one frame."""
        world, patch, thread = wp.tid()
        tile = wp.tile_empty(shape=capacity, dtype=wp.vec3, storage="shared")
        seat = take_patch(patches, first_world, worlds_at_work, world, patch, thread)
        frame_begin = float(0.0)
        if wp.static(traits.tells_time):
            frame_begin = float(memory.frame[0]) * t.frame_seconds
        if wp.static(traits.gas):
            gas.begin(state, seat, patches.balloons[patch])
        in_world = take_seat(state, seat.world, thread)
        member = seat_member(t, slots, state, in_world, patches.numbers[patch, thread])
        member = take_place(state, memory, seat, member)
        put_in_tile(tile, thread, member.point)
        if seat.rim >= 0:
            put_in_tile(tile, threads + thread, state.points[seat.world, seat.rim])
        block_barrier()
        member = pieces.fill(t, in_world, member)  # once: whose gas changes is in no patches
        for number in range(t.substeps):
            member = substep(t, state, memory, patches, seat, member, frame_begin, number, tile)
        if member.active:
            state.points[seat.world, member.own.number] = member.point
            state.velocities[seat.world, member.own.number] = member.velocity

    return advance_patches

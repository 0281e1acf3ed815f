"""Particles of a block that are put off, see `deferred`: they end their substep when all have moved, by as few warps as
they are many."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.contact.forces import is_touched
from balloon_warp.kernels.memory import in_tile, put_in_tile
from balloon_warp.kernels.schedules.block.deferred import later_functions
from balloon_warp.kernels.schedules.block.memory import BlockMemory, Layout, Seat, velocity_functions
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import block_barrier, count_at, next_in_block, put_count, shared_words


class Later(NamedTuple):
    """What a block does with them."""

    begin: Any
    """(seat): as a frame begins; a barrier must follow"""
    note: Any
    """(t, memory, seat, member, start): a particle that has moved from there, or is put off"""
    end: Any
    """(t, state, memory, seat, points, velocities): their substep, between two barriers"""


@cache
def later_of(traits: Traits, seat_member: Any, layout: Layout) -> Later:
    """For what a scene has."""
    may_stand, from_where, end_later = later_functions(traits)
    velocity_at, put_velocity = velocity_functions(layout)
    counts = shared_words("later", 2)

    @wp.func
    def begin(seat: Seat):
        if seat.thread == 0:
            put_count(counts(), 0, 0)
            put_count(counts(), 1, 0)

    @wp.func
    def waits(t: Tables, memory: BlockMemory, seat: Seat, member: Any):
        """Whether it is put off."""
        touched = bool(False)
        if wp.static(traits.pushes_come_last):
            touched = is_touched(memory.contacts, seat.world, member.own.number)
        return touched or may_stand(t, member.own, seat.time + t.step_seconds, member.point)

    @wp.func
    def note(t: Tables, memory: BlockMemory, seat: Seat, member: Any, start: wp.vec3):
        if member.active and waits(t, memory, seat, member):
            memory.contacts.later[seat.world, next_in_block(counts(), seat.substep & 1)] = member.own.number
            member.point = from_where(start, member.point)
        return member

    @wp.func
    def end(t: Tables, state: WorldState, memory: BlockMemory, seat: Seat, points: Any, velocities: Any):
        block_barrier()
        if seat.thread == 0:
            put_count(counts(), (seat.substep + 1) & 1, 0)
        for place in range(seat.thread, count_at(counts(), seat.substep & 1), wp.block_dim()):
            member = seat_member(t, 0, state, seat, memory.contacts.later[seat.world, place])
            number = member.own.number
            point, velocity = end_later(
                t, memory.contacts, member.own, member.gain, seat.time + t.step_seconds, in_tile(points, number),
                velocity_at(velocities, number),
            )  # fmt: skip
            put_in_tile(points, number, point)
            put_velocity(velocities, number, velocity)
        block_barrier()

    return Later(begin, note, end)

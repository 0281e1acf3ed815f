"""The particles that a thread of a block goes through in turns, where it has many."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.measure.health import look_at_particle
from balloon_warp.kernels.memory import in_tile, put_in_tile
from balloon_warp.kernels.schedules.block.board import Board
from balloon_warp.kernels.schedules.block.gas import GasSums
from balloon_warp.kernels.schedules.block.memory import BlockMemory, Layout, Seat, velocity_functions
from balloon_warp.kernels.schedules.block.pieces import Pieces
from balloon_warp.kernels.schedules.block.touch import touching
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import any_in_block


class Turns(NamedTuple):
    """What a thread does with one of its particles."""

    mass: Any
    """(t, seat, turn, state): of the particle that it has in a turn, and what moves with it [kg]"""
    member: Any
    """(t, state, memory, seat, first, turn, points, velocities): that particle, beside the first of the world"""
    leave: Any
    """(t, seat, member): out of obstacles"""
    put: Any
    """(seat, member, target, velocities): where others and the next substep find it"""
    keep_aim: Any
    """(memory, seat, member): for later, if it came on the way"""
    end: Any
    """(t, state, memory, seat, points, velocities): what a frame ends with"""


@cache
def turns_of(
    traits: Traits, pieces: Pieces, gas: GasSums, member_type: Any, seat_member: Any, seat_beside: Any, layout: Layout
) -> Turns:
    """For what a scene has."""
    Member, threads = member_type, layout.threads  # noqa: N806 - a type
    velocity_at, put_velocity = velocity_functions(layout)

    @wp.func
    def mass_in_turn(t: Tables, seat: Seat, turn: wp.int32, state: WorldState):
        """Of the particle that a thread has in a turn, and what moves with it [kg]."""
        member = pieces.fill(t, seat, seat_member(t, 0, state, seat, turn * threads + seat.thread))
        return member.inertia

    @wp.func
    def member_in_turn(
        t: Tables,
        state: WorldState,
        memory: BlockMemory,
        seat: Seat,
        first: Member,
        turn: wp.int32,
        points: Any,
        velocities: Any,
    ):
        """The particle that a thread has in a turn, beside the first of the world."""
        member = seat_beside(t, 0, state, seat, turn * threads + seat.thread, first)
        member.point = in_tile(points, member.own.number)
        member.velocity = velocity_at(velocities, member.own.number)
        if wp.static(traits.keeps_aims):
            member.aim = memory.aims[seat.world, member.own.number]
        if wp.static(traits.gas):
            member.load = gas.load_at(member.own.balloon)
            member = pieces.fill(t, seat, member)
        return member

    @wp.func
    def leave(t: Tables, seat: Seat, member: Member):
        """Out of obstacles."""
        if wp.static(traits.penalties):
            left, _other = pieces.leave(t, seat, member, member)
            member = left
        if wp.static(traits.stands):
            member = pieces.stand(t, seat, member)
        return member

    @wp.func
    def put_member(seat: Seat, member: Member, target: Any, velocities: Any):
        """Where others and the next substep find it."""
        if member.active:
            put_velocity(velocities, member.own.number, member.velocity)
            put_in_tile(target, member.own.number, member.point)

    @wp.func
    def keep_aim(memory: BlockMemory, seat: Seat, member: Member):
        """Where it is found on the way, for later."""
        if wp.static(traits.keeps_aims and traits.aims_on_the_way):
            if member.active:
                memory.aims[seat.world, member.own.number] = member.aim

    @wp.func
    def end(t: Tables, state: WorldState, memory: BlockMemory, seat: Seat, points: Any, velocities: Any):
        """Every particle as a frame ends."""
        for particle in range(seat.thread, seat.count, wp.block_dim()):
            number = memory.numbers[particle]
            state.points[seat.world, number] = points[particle]
            state.velocities[seat.world, number] = velocity_at(velocities, particle)
            look_at_particle(
                t.health, state.first_bad, seat.world, particle, number, t.particles.balloon[particle],
                t.particles.mass_share[particle], points,
            )  # fmt: skip

    return Turns(mass_in_turn, member_in_turn, leave, put_member, keep_aim, end)


@cache
def touching_in_turns(
    traits: Traits, pieces: Pieces, board: Board, turns: Turns, seat_member: Any, layout: Layout
) -> Any:
    """The function by which spheres and particles exchange momentum, where a thread has many."""
    touch = touching(traits, board, turns.mass, layout)
    velocity_at, threads = velocity_functions(layout)[0], layout.threads

    @wp.func
    def touch_all(t: Tables, state: WorldState, seat: Seat, rounds: wp.int32, points: Any, velocities: Any):
        """Spheres and particles exchange momentum, where any are near."""
        near = bool(False)
        for turn in range(rounds):
            member = seat_member(t, 0, state, seat, turn * threads + seat.thread)
            member.point = points[member.own.number]
            member.velocity = velocity_at(velocities, member.own.number)
            near = near or pieces.is_near(t, seat, member, member)
        if any_in_block(near):
            touch(t, seat, near, state, points, velocities)

    return touch_all


@cache
def leaving_in_turns(traits: Traits, turns: Turns, member_type: Any) -> Any:
    """The function by which particles leave obstacles when all have moved, where a thread has many."""
    Member = member_type  # noqa: N806 - a type

    @wp.func
    def leave_all(
        t: Tables,
        state: WorldState,
        memory: BlockMemory,
        seat: Seat,
        first: Member,
        rounds: wp.int32,
        points: Any,
        velocities: Any,
    ):
        """Particles out of obstacles, when all have moved."""
        for turn in range(rounds):
            member = turns.member(t, state, memory, seat, first, turn, points, velocities)
            if wp.static(traits.keeps_inflations and traits.pressures):
                member.push = memory.inflations[seat.world, member.own.number]
            turns.put(seat, turns.leave(t, seat, member), points, velocities)

    return leave_all

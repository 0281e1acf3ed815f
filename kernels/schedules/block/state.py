"""How a particle that stays in a thread's registers for a frame comes from the state, and goes back to it."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.measure.health import is_past, look_at_particle
from balloon_warp.kernels.memory import put_in_tile
from balloon_warp.kernels.schedules.block.memory import BlockMemory, Layout, Seat
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits


@cache
def state_functions(traits: Traits, layout: Layout, member: Any) -> tuple[Any, Any]:
    """The functions that take a particle with a frame's beginning, its point into a tile, too, and that put it back.

    Args:
        member: the type of a particle.
    """
    renumbered = bool(layout.film and layout.film.own_slots)
    Member = member  # noqa: N806 - a type

    @wp.func
    def number_of(memory: BlockMemory, particle: wp.int32):
        """In the model."""
        if wp.static(renumbered):
            return memory.numbers[particle]
        else:
            return particle

    @wp.func
    def take_place(
        state: WorldState,
        memory: BlockMemory,
        seat: Seat,
        member: Member,
        place: wp.int32,
        points: Any,
        velocities: wp.array[wp.vec3],
    ):
        """A particle with a frame's beginning; its point into the tile."""
        number = number_of(memory, member.own.number)
        member.load = state.inflation_loads[seat.world, member.own.balloon]
        member.point = state.points[seat.world, number]
        member.velocity = state.velocities[seat.world, number]
        if wp.static(traits.looks_at_velocities and traits.frames == "free"):
            velocities[member.own.number] = member.velocity
        put_in_tile(points, place, member.point)
        return member

    @wp.func
    def end_member(
        t: Tables, state: WorldState, memory: BlockMemory, seat: Seat, place: wp.int32, member: Member, points: Any
    ):
        """What a frame ends with; what the substeps do not need is read again, so that it takes no register."""
        if place < seat.count:
            number = number_of(memory, place)
            state.points[seat.world, number] = member.point
            state.velocities[seat.world, number] = member.velocity
            if is_past(member.point, t.health.near):  # few are
                look_at_particle(
                    t.health, state.first_bad, seat.world, place, number, t.particles.balloon[place],
                    t.particles.mass_share[place], points,
                )  # fmt: skip

    return take_place, end_member

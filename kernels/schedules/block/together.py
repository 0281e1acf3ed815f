"""What the threads of a block do together in a substep, each with the one or two particles in its registers."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.loops.areas import volume_origin
from balloon_warp.kernels.memory import in_tile, put_in_tile
from balloon_warp.kernels.schedules.block.board import Board
from balloon_warp.kernels.schedules.block.correct import correcting
from balloon_warp.kernels.schedules.block.gas import GasSums
from balloon_warp.kernels.schedules.block.memory import Layout, Seat, pair_functions
from balloon_warp.kernels.schedules.block.pieces import Pieces
from balloon_warp.kernels.schedules.block.refresh import Refresh
from balloon_warp.kernels.schedules.block.touch import one_of_two, touching
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import any_in_block, block_barrier


class Together(NamedTuple):
    """Functions of both particles, which return them."""

    aim: Any
    """(t, seat, mine, also, points, centers, areas): by the faces; before them the area of the balloon"""
    swell: Any
    """(t, state, seat, mine, also, points): the pressures"""
    leave: Any
    """(t, seat, mine, also, target, velocities): out of obstacles"""
    correct: Any
    """(t, seat, mine, also, target, velocities): springs that are too long, and then out of obstacles"""


@cache
def together_of(
    traits: Traits, pieces: Pieces, board: Board, gas: GasSums, refresh: Refresh, member_type: Any, layout: Layout
) -> Together:
    """For what a scene has."""
    Member, threads, two = member_type, layout.threads, layout.two  # noqa: N806 - a type
    shorten = correcting(traits, layout)
    touch = touching(traits, board, one_of_two, layout)
    put_members, get_members = pair_functions(layout)

    @wp.func
    def aim(t: Tables, seat: Seat, mine: Member, also: Member, points: Any, centers: Any, areas: Any):
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
    def swell(t: Tables, state: WorldState, seat: Seat, mine: Member, also: Member, points: Any):
        """The pressures, once all particles have their free velocities."""
        gas.clear(seat)
        origin = in_tile(points, seat.origin)
        if wp.static(traits.balloons > 1):
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
    def leave(t: Tables, seat: Seat, mine: Member, also: Member, target: Any, velocities: wp.array[wp.vec3]):
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
    def correct(t: Tables, seat: Seat, mine: Member, also: Member, target: Any, velocities: wp.array[wp.vec3]):
        """Springs shortened in the target, then out of obstacles."""
        put_members(seat, mine, also, target, velocities)
        block_barrier()
        shorten(t, seat, target, velocities)
        back, other_back = get_members(seat, mine, also, target, velocities)
        left, other_left = leave(t, seat, back, other_back, target, velocities)
        put_in_tile(target, seat.thread, left.point)
        if wp.static(two):
            put_in_tile(target, seat.thread + threads, other_left.point)
        return left, other_left

    return Together(aim, swell, leave, correct)

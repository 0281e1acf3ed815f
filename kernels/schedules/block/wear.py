"""What becomes of membranes as they are stretched, in a block: each thread looks at some triangles before all of them
look for forces. What the triangles have borne waits in memory until the frame has gone well."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.loops.wear import wear_function
from balloon_warp.kernels.memory import in_tile
from balloon_warp.kernels.own import numbers_reader
from balloon_warp.kernels.schedules.block.memory import BlockMemory, Seat
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import block_barrier


class Wear(NamedTuple):
    """Functions of all threads of a block."""

    find: Any
    """(t, state, memory, seat, points): what is left of their tensions; nobody goes on before it is found"""
    end: Any
    """(t, state, memory, seat): into the state"""


@cache
def wear_in_block(traits: Traits) -> Wear:
    """For what a scene has."""
    wear = wear_function(traits, in_tile)
    read_numbers = numbers_reader(traits.columns)

    @wp.func
    def find(t: Tables, state: WorldState, memory: BlockMemory, seat: Seat, points: Any):
        for triangle in range(seat.thread, t.membranes.corners.shape[0], wp.block_dim()):
            n = read_numbers(t, seat.world, t.particles.balloon[t.membranes.corners[triangle][0]])
            peak = memory.peaks[seat.world, triangle]
            if seat.substep == 0:
                peak = state.peaks[seat.world, triangle]
            left, greatest, _stress = wear(t, seat.world, triangle, points, peak, n)
            t.membranes.wear.left[seat.world, triangle] = left
            memory.peaks[seat.world, triangle] = greatest
        block_barrier()

    @wp.func
    def end(t: Tables, state: WorldState, memory: BlockMemory, seat: Seat):
        for triangle in range(seat.thread, t.membranes.corners.shape[0], wp.block_dim()):
            state.peaks[seat.world, triangle] = memory.peaks[seat.world, triangle]

    return Wear(find, end)

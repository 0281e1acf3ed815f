"""Springs that are too long are shortened, by the threads of a block: color by color, with a barrier after each."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.correction import excess, moves_of_ends
from balloon_warp.kernels.memory import float_at, in_tile, int_pair_at, put_in_tile
from balloon_warp.kernels.schedules.block.memory import Layout, Seat, velocity_functions
from balloon_warp.kernels.tables import Tables, row_of_world
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import block_barrier


@cache
def correcting(traits: Traits, layout: Layout) -> Any:
    """The function that corrects."""
    velocity_at, put_velocity = velocity_functions(layout)
    column = traits.columns.places.get("correction_limit", 0) - traits.columns.balloon_width

    @wp.func
    def correct_spring(t: Tables, limit: float, spring: wp.int32, points: Any, velocities: Any):
        ends = int_pair_at(t.correction.particles, spring)
        p = ends[0]
        q = ends[1]
        at_p = in_tile(points, p)
        at_q = in_tile(points, q)
        too_long = excess(at_q - at_p, float_at(t.correction.rest_lengths, spring), limit)
        if wp.length_sq(too_long) > 0.0:  # few are: what the others would write takes longer than all the rest
            move_p, move_q = moves_of_ends(
                float_at(t.particles.mass_share, p), float_at(t.particles.mass_share, q), too_long
            )
            put_in_tile(points, p, at_p + move_p)
            put_in_tile(points, q, at_q + move_q)
            put_velocity(velocities, p, velocity_at(velocities, p) + move_p / t.step_seconds)
            put_velocity(velocities, q, velocity_at(velocities, q) + move_q / t.step_seconds)

    @wp.func
    def correct(t: Tables, seat: Seat, points: Any, velocities: Any):
        """All sweeps; a barrier must have come before."""
        limit = t.world_numbers[row_of_world(seat.world, t.world_numbers.shape[0]), column]
        colors = t.correction.color_offsets.shape[0] - 1
        for color_of_sweep in range(t.correction.sweeps * colors):
            color = color_of_sweep % colors
            begin = t.correction.color_offsets[color] + seat.thread
            for spring in range(begin, t.correction.color_offsets[color + 1], wp.block_dim()):
                correct_spring(t, limit, spring, points, velocities)
            block_barrier()

    return correct

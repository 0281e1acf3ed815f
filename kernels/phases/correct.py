"""Position correction: springs that are too long are shortened, color by color (Provot 1995)."""

from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.correction import excess, moves_of_ends
from balloon_warp.kernels.memory import float_at, int_pair_at
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, row_of_world


@phase("spring", when=lambda features: features.corrected)
def correct(features: Features, look: Look) -> Any:
    """Shorten a spring that is too long; no two of one color end at one particle."""
    at, put, velocity_at, put_velocity = look.at, look.put, look.velocity_at, look.put_velocity
    limit_column = features.columns.places["correction_limit"] - features.columns.balloon_width

    @wp.func
    def correct(t: Tables, points: Any, velocities: Any, world: wp.int32, spring: wp.int32):
        ends = int_pair_at(t.correction.particles, spring)
        p = ends[0]
        q = ends[1]
        at_p = at(points, p)
        at_q = at(points, q)
        limit = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), limit_column]
        too_long = excess(at_q - at_p, float_at(t.correction.rest_lengths, spring), limit)
        if wp.length_sq(too_long) > 0.0:  # few are: the writes of the others would take longer than all the rest
            move_p, move_q = moves_of_ends(
                float_at(t.particles.mass_share, p), float_at(t.particles.mass_share, q), too_long
            )
            put(points, p, at_p + move_p)
            put(points, q, at_q + move_q)
            put_velocity(velocities, p, velocity_at(velocities, p) + move_p / t.step_seconds)
            put_velocity(velocities, q, velocity_at(velocities, q) + move_q / t.step_seconds)

    return correct

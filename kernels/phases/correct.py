"""Position correction: springs that are too long are shortened, color by color (Provot 1995)."""

from typing import Any

import warp as wp

from balloon_warp.kernels.laws.correction import excess, moves_of_ends
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, row_of_world
from balloon_warp.kernels.traits import Traits


@phase("spring", when=lambda traits: traits.corrected)
def correct(traits: Traits, look: Look) -> Any:
    """Shorten a spring that is too long; no two of one color end at one particle."""
    at, put = look.at, look.put
    limit_column = traits.columns.places["correction_limit"] - traits.columns.balloon_width

    @wp.func
    def correct(t: Tables, points: Any, velocities: Any, world: wp.int32, spring: wp.int32):
        p = t.correction.particles[spring][0]
        q = t.correction.particles[spring][1]
        limit = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), limit_column]
        too_long = excess(at(points, q) - at(points, p), t.correction.rest_lengths[spring], limit)
        if wp.length_sq(too_long) > 0.0:
            move_p, move_q = moves_of_ends(t.particles.mass_share[p], t.particles.mass_share[q], too_long)
            put(points, p, at(points, p) + move_p)
            put(points, q, at(points, q) + move_q)
            put(velocities, p, at(velocities, p) + move_p / t.step_seconds)
            put(velocities, q, at(velocities, q) + move_q / t.step_seconds)

    return correct

"""Particles that have come to where none can be, looked for as a frame ends that surely counts."""

from typing import Any

import warp as wp

from balloon_warp.kernels.measure.health import look_at_particle
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits


@phase("particle", last=True, when=lambda traits: traits.frames == "all")
def check(traits: Traits, look: Look) -> Any:
    """Record the first particle at a place that it cannot have."""

    @wp.func
    def check(t: Tables, state: WorldState, points: Any, own: Any, particle: wp.int32, number: wp.int32):
        balloon, share = own.balloon, own.share
        look_at_particle(t.health, state.first_bad, own.world, particle, number, balloon, share, points)

    return check

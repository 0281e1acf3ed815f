"""Particles that have come to where none can be, looked for as a frame ends that surely counts."""

from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.measure.health import look_at_particle
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, WorldState


@phase("particle", last=True, when=lambda features: features.frames == "all")
def check(features: Features, look: Look) -> Any:
    """Record the first particle at a place that it cannot have."""

    @wp.func
    def check(t: Tables, state: WorldState, points: Any, params: Any, particle: wp.int32, number: wp.int32):
        balloon, share = params.balloon, params.share
        look_at_particle(t.health, state.first_bad, params.world, particle, number, balloon, share, points)

    return check

"""The load of a liquid on a particle, which laws read, and on the way back others ask for the derivatives of."""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.water import soak_backwards
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import Look, phase


@phase("particle", {"water_load": wp.vec4}, when=lambda features: features.in_water, adjoint=soak_backwards)
def soak(features: Features, look: Look) -> Any:
    """Find the load of a liquid on a particle: depth times area vector [m^3], and wetted area [m^2]."""
    load_of_particle = look.loops(features).water_load

    @wp.func
    def soak(t: Any, points: Any, params: Any):
        return load_of_particle(t, points, params)

    return soak

"""Inertia of a particle, with that of gas and added mass."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working


@cache
def inertia_function(features: Features) -> Any:
    """Return the function for a particle's mass with its share of the gas and added mass [kg]; 0 if fixed."""

    @wp.func
    def inertia(working: Working, params: Any):
        if wp.static(features.gas):
            return params.mass + params.share * working.gas_masses[params.world, params.balloon]
        else:
            return params.mass

    return inertia


@cache
def ease_function(features: Features) -> Any:
    """Return the function for the inverse effective mass of a particle [1/kg], 0 if it is fixed."""
    _, read_params = params_functions(features.columns, features.balloons)
    inertia = inertia_function(features)

    @wp.func
    def ease_of_moving(t: Tables, working: Working, world: wp.int32, particle: wp.int32):
        mass = inertia(working, read_params(t, world, particle))
        return wp.where(mass > 0.0, 1.0 / mass, 0.0)

    return ease_of_moving

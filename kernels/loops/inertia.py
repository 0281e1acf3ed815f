"""Inertia of a particle, with that of gas and added mass."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.own import own_functions
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.working import Working


@cache
def inertia_function(traits: Traits) -> Any:
    """Return the function for a particle's mass with its share of the gas and added mass [kg]; 0 if fixed."""

    @wp.func
    def inertia(working: Working, own: Any):
        if wp.static(traits.gas):
            return own.mass + own.share * working.gas_masses[own.world, own.balloon]
        else:
            return own.mass

    return inertia


@cache
def ease_function(traits: Traits) -> Any:
    """Return the function for the inverse effective mass of a particle [1/kg], 0 if it is fixed."""
    _, read_own = own_functions(traits.columns, traits.balloons)
    inertia = inertia_function(traits)

    @wp.func
    def ease_of_moving(t: Tables, working: Working, world: wp.int32, particle: wp.int32):
        mass = inertia(working, read_own(t, world, particle))
        return wp.where(mass > 0.0, 1.0 / mass, 0.0)

    return ease_of_moving

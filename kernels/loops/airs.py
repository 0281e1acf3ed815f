"""The air that a balloon's gas meets: the same everywhere, or that at the balloon's height."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.air import STATE_OF_AIR, density_of_air
from balloon_warp.kernels.laws.gas import free_volume_there
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world


@cache
def air_function(features: Features) -> Any:
    """Return the function for the air at a balloon: pressure [Pa], temperature [K] and density [kg/m^3]."""
    of_world = [features.columns.places[row.name] - features.columns.balloon_width for row in STATE_OF_AIR]
    pressure_column, temperature_column, density_column = of_world

    @wp.func
    def air_at(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32):
        if wp.static(features.gas_meets_air):
            return state.airs[world, balloon]
        else:
            row = row_of_world(world, t.world_numbers.shape[0])
            pressure = t.world_numbers[row, pressure_column]
            temperature = t.world_numbers[row, temperature_column]
            return wp.vec3(
                pressure, temperature, density_of_air(pressure, temperature, t.world_numbers[row, density_column])
            )

    return air_at


@cache
def warmth_function(features: Features) -> Any:
    """Return the function that corrects free volumes of gas by the air's temperature at the balloon.

    See `laws.gas.free_volume_there`.
    """
    temperature_column = features.columns.places["air_temperature"] - features.columns.balloon_width
    gamma_column = features.columns.places["gamma"]

    @wp.func
    def as_warm_there(t: Tables, world: wp.int32, balloon: wp.int32, free_volume: float, air: wp.vec3):
        if wp.static(features.gas_meets_air):
            gamma = t.balloon_numbers[row_of_world(world, t.balloon_numbers.shape[0]), balloon, gamma_column]
            level = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), temperature_column]
            return free_volume_there(free_volume, gamma, air[1] / level)
        else:
            return free_volume

    return as_warm_there

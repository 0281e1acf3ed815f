"""Air around a balloon that moves along with it: added mass.

A body that is accelerated in a fluid pushes that aside, and so sets it going: as if a part c of the displaced fluid
were fixed to it, c = 1/2 for a sphere (Lamb, *Hydrodynamics*, section 92). It has inertia, and no weight.

All particles bear it in proportion to their mass. For the balloon as a whole that is exact. Where its surface swings in
n waves, a sphere's air has rho R / (n + 1) for each square meter along the normal, and here there is rho R / 6: half of
it for n = 2, just that for n = 5; where it breathes, a sixth of the rho R of air that would not give.
"""

import warp as wp

from balloon_warp.kernels.laws.air import air_of_height
from balloon_warp.kernels.laws.gas import STANDARD_PRESSURE, THINNEST, free_volume_there, volume_at
from balloon_warp.kernels.laws.law import Parameter

ADDED_MASS = Parameter(
    "added_mass",
    "1",
    0.5,
    least=0.0,
    most=100.0,
    path="inflation.added_mass",
    meaning="Added mass coefficient of a gas balloon, as a fraction of the displaced air's mass: 0.5 for a "
    "sphere, 0 for none",
)


@wp.func
def volume_of_gas(pressure: float, free_volume: float, gamma: float, air_pressure: float):
    """Return the volume of a gas from its gauge pressure [m^3], for `gas_pressure`."""
    return volume_at(free_volume, wp.max(air_pressure + pressure, THINNEST * STANDARD_PRESSURE), gamma)


@wp.func
def air_along(
    height: float,
    pressure: float,
    free_volume: float,
    added_mass: float,
    gamma: float,
    air_pressure: float,
    air_temperature: float,
    air_density: float,
    air_lapse: float,
    gravity: float,
):
    """Return the mass of the air that moves along with a balloon at a height [kg]."""
    air = air_of_height(height, air_pressure, air_temperature, air_density, air_lapse, gravity)
    there = free_volume_there(free_volume, gamma, air[1] / air_temperature)
    return added_mass * air[2] * volume_of_gas(pressure, there, gamma, air[0])

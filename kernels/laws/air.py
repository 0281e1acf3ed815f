"""The air around balloons: its density, and its drag."""

from typing import Any

import warp as wp

from balloon_warp.kernels.laws.law import TINY, Law, Parameter

GAS_CONSTANT = 8.314462618
"""[J/(mol K)]"""
DRY_AIR_MOLAR_MASS = 0.0289652
"""[kg/mol]"""
OF_DRY_AIR = -1.0
"""stands for the density of dry air as an ideal gas"""


@wp.func
def molar_volume(air_pressure: float, air_temperature: float):
    """Of any gas that is as cold and as dense as the air [m^3/mol]: R T / p."""
    return GAS_CONSTANT * air_temperature / air_pressure


@wp.func
def density_of_air(air_pressure: float, air_temperature: float, air_density: float):
    """Given, or of dry air as an ideal gas where that is negative [kg/m^3]."""
    if air_density < 0.0:
        return DRY_AIR_MOLAR_MASS / molar_volume(air_pressure, air_temperature)
    return air_density


@wp.func
def air_drag(
    velocity: wp.vec3,
    area_vector: wp.vec3,
    air_pressure: float,
    air_temperature: float,
    air_density: float,
    drag_coefficient: float,
    wind: wp.vec3,
):
    """Force of the air on a particle [N]: 1/2 density C_d (u . n)^2 of its area, against u . n, along its normal n.

    u is the velocity relative to the wind. Over a sphere in steady motion, whose front and back both count, this
    adds up to 1/2 density C_d pi R^2 u^2: the integral of |cos|^3 over it is pi R^2. A flat balloon across the wind
    gets twice that for its area, which is about how plates compare with spheres.
    """
    density = density_of_air(air_pressure, air_temperature, air_density)
    flux = wp.dot(velocity - wind, area_vector)
    squared_area = wp.max(wp.length_sq(area_vector), 1.0e-30)
    return (-0.5 * density * drag_coefficient * flux * wp.abs(flux) / squared_area) * area_vector


AIR = (
    Parameter("air_pressure", "Pa", 101325.0, least=TINY, of="world", path="atmosphere.pressure"),
    Parameter(
        "air_temperature",
        "K",
        293.15,
        least=TINY,
        of="world",
        path="atmosphere.temperature",
        meaning="of the air, and of gas at its pressure",
    ),
    Parameter(
        "air_density",
        "kg/m^3",
        OF_DRY_AIR,
        least=0.0,
        of="world",
        path="atmosphere.density",
        meaning="that of dry air as an ideal gas when missing",
    ),
)


def drag_bound(
    area: Any,
    velocity: Any,
    air_pressure: Any,
    air_temperature: Any,
    air_density: Any,
    drag_coefficient: Any,
    wind: Any,
) -> Any:
    """Density C_d A u [N s/m], the derivative of the drag at the speed u through the air."""
    density = density_of_given_air(air_pressure, air_temperature, air_density)
    speed = ((velocity - wind) ** 2).sum(axis=-1) ** 0.5
    return density * drag_coefficient * area * speed


def density_of_given_air(air_pressure: Any, air_temperature: Any, air_density: Any) -> Any:
    """The same as `density_of_air`, of many worlds on the host [kg/m^3]."""
    dry = DRY_AIR_MOLAR_MASS / (GAS_CONSTANT * air_temperature / air_pressure)
    return (air_density < 0.0) * dry + (air_density >= 0.0) * air_density


AIR_DRAG = Law(
    "particle",
    air_drag,
    (
        *AIR,
        Parameter(
            "drag_coefficient",
            "1",
            least=0.0,
            path="drag_coefficient",
            meaning="C_d of 1/2 density C_d A u^2, as for a sphere, u the speed relative to the wind",
        ),
        Parameter("wind", "m/s", of="world", path="atmosphere.wind", size=3, meaning="velocity of the air"),
    ),
    neutral={"drag_coefficient": 0.0},
    drag=drag_bound,
)

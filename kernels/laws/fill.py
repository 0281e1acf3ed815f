"""Filling a balloon: breaths, litres or moles over some time, or the flow of a pump, up to a pressure or a diameter."""

import math

import warp as wp

from balloon_warp.kernels.laws.air import GAS_CONSTANT, molar_volume
from balloon_warp.kernels.laws.law import Parameter

BREATH = 3.5e-3
"""Volume of an adult's deep breath [m^3], the inspiratory capacity (Hall, *Guyton and Hall Textbook of Medical
Physiology*, "pulmonary volumes and capacities")"""
LITRE = 1.0e-3
"""Litre [m^3]"""
SHORTEST = 1.0e-6
"""Shortest time of a fill [s]"""


def _filled(name: str, unit: str, meaning: str, default: float = 0.0) -> Parameter:
    return Parameter(f"fill_{name}", unit, default, least=0.0, path=f"inflation.{name}", meaning=meaning)


FILL = (
    _filled(
        "breaths",
        "1",
        'Number of deep breaths blown into the balloon, of kind "gas", each of 3.5 l at ambient pressure, '
        "an adult's inspiratory capacity",
    ),
    _filled("litres", "l", 'Volume of gas at ambient pressure blown into the balloon, of kind "gas"'),
    _filled("moles", "mol", 'Amount of gas blown into the balloon, of kind "gas"'),
    Parameter(
        "fill_time",
        "s",
        1.0,
        least=SHORTEST,
        path="inflation.fill_time",
        meaning="Time in which breaths, litres or moles are blown in, at a constant rate from the start, of kind "
        '"gas"; with `fill_to_pressure` or `fill_to_diameter`, the time of each breath',
    ),
    Parameter(
        "fill_to_pressure",
        "Pa",
        0.0,
        least=0.0,
        path="inflation.fill_to_pressure",
        meaning='Gauge pressure at which blowing stops, of kind "gas"; 0 sets no such limit',
    ),
    Parameter(
        "fill_to_diameter",
        "m",
        0.0,
        least=0.0,
        path="inflation.fill_to_diameter",
        meaning='Diameter of the sphere of equal volume at which blowing stops, of kind "gas"; 0 sets no such limit',
    ),
)


@wp.func
def blown_in(
    fill_breaths: float,
    fill_litres: float,
    fill_moles: float,
    fill_time: float,
    air_pressure: float,
    air_temperature: float,
    time: float,
    step_seconds: float,
):
    """Return the amount blown in during a step [mol]; over all steps exactly the given amount."""
    volume = fill_litres * LITRE + fill_breaths * BREATH
    amount = fill_moles + volume / molar_volume(air_pressure, air_temperature)
    during = wp.clamp(fill_time - time, 0.0, step_seconds)
    return amount * during / fill_time


@wp.func
def breath_in(fill_time: float, air_pressure: float, air_temperature: float, step_seconds: float):
    """Return the amount blown in during a step at one breath per `fill_time` [mol]."""
    return BREATH / molar_volume(air_pressure, air_temperature) * step_seconds / fill_time


@wp.func
def up_to(
    moles: float,
    pressure: float,
    volume: float,
    fill_to_pressure: float,
    fill_to_diameter: float,
    gamma: float,
    air_pressure: float,
    air_temperature: float,
):
    """Return how many of some moles come in before a balloon is full: as if it were rigid."""
    allowed = moles
    full = GAS_CONSTANT * air_temperature
    if fill_to_pressure > 0.0:
        allowed = wp.min(allowed, (fill_to_pressure - pressure) * volume / (gamma * full))
    if fill_to_diameter > 0.0:
        room = wp.static(math.pi / 6.0) * wp.pow(fill_to_diameter, 3.0) - volume
        allowed = wp.min(allowed, room * (air_pressure + pressure) / full)
    return wp.clamp(allowed, 0.0, moles)

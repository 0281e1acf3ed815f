"""Gas that flows: breaths, litres or moles over some time, a pump, up to a pressure or a diameter; and openings.

An opening is the neck of a balloon that is let go, or a hole that it leaks through. By Bernoulli's law a gas of the
density rho leaves from the pressure p above the air's at u = sqrt(2 p / rho); of the opening's area A the stream fills
C_d A, so that rho C_d A u leaves each second, and pushes back by that times u: 2 C_d A p. C_d is 0.95 to 0.99 where a
nozzle leads to the opening, as a balloon's neck does (ISO 5167-3), 0.61 of a hole with a sharp edge (Kirchhoff's pi /
(pi + 2)).

On the way the gas expands without heat, and in the throat it is nowhere faster than sound, so that the pressure there
stays above the air's from some 90 kPa on (de Saint-Venant and Wantzel 1839): less of it leaves than of a liquid, by a
hundredth at 2 kPa. See `nozzle`.

Gas that is drawn in, where p is negative, comes from all sides, and gives its momentum to the gas inside: it has no
thrust.

The pressure acts on the faces that close the neck in the mesh as on all others, so that it has no net force; the thrust
is that of the open neck, all of it, and is counted once.
"""

import math

import warp as wp

from balloon_warp.kernels.algebra import power
from balloon_warp.kernels.laws.air import DRY_AIR_MOLAR_MASS, GAS_CONSTANT, density_of_air, molar_volume
from balloon_warp.kernels.laws.gas import STANDARD_PRESSURE, THINNEST, throttled, volume_at
from balloon_warp.kernels.laws.law import FAR, Parameter

BREATH = 3.5e-3
"""Volume of an adult's deep breath [m^3], the inspiratory capacity (Hall, *Guyton and Hall Textbook of Medical
Physiology*, "pulmonary volumes and capacities")"""
LITRE = 1.0e-3
"""Litre [m^3]"""
SHORTEST = 1.0e-6
"""Shortest time of a fill [s]"""


def _filled(name: str, unit: str, meaning: str, default: float = 0.0) -> Parameter:
    return Parameter(f"fill_{name}", unit, default, least=0.0, path=f"inflation.{name}", meaning=meaning)


FILL_PARAMETERS = (
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
    """Amount of gas, of some moles, that fills a balloon as if it were rigid."""
    allowed = moles
    full = GAS_CONSTANT * air_temperature
    if fill_to_pressure > 0.0:
        allowed = wp.min(allowed, (fill_to_pressure - pressure) * volume / (gamma * full))
    if fill_to_diameter > 0.0:
        room = wp.static(math.pi / 6.0) * wp.pow(fill_to_diameter, 3.0) - volume
        allowed = wp.min(allowed, room * (air_pressure + pressure) / full)
    return wp.clamp(allowed, 0.0, moles)


LEAST_FLOW = 1.0e-30
"""Least divisor, and least number under a root, where nothing flows: the slope of a root has no bound at 0"""
NEVER = 1.0e9
"""Time that is never reached [s]"""
SHARP_EDGE = wp.constant(math.pi / (math.pi + 2.0))
"""C_d of a hole with one"""
ADIABATIC = wp.constant(1.4)
"""Least exponent of a gas that passes an opening, that of air: without the time for heat that `gamma` may allow for"""
SLIGHT = wp.constant(0.05)
"""Largest fraction of the pressure that is lost for which a series gives the speed: a power has too few digits there"""
OPENING_PARAMETERS = (
    Parameter(
        "neck_diameter",
        "m",
        0.01,
        least=0.0,
        path="neck.diameter",
        absent=0.0,
        meaning="Diameter of the opening, however far the rubber around it is stretched; 0 is closed",
    ),
    Parameter(
        "neck_discharge",
        "1",
        1.0,
        least=0.0,
        most=1.0,
        path="neck.discharge",
        meaning="Discharge coefficient, the fraction of the opening that the stream fills: 0.95 to 1 for a "
        "smoothly narrowing neck, 0.61 for a sharp-edged hole",
    ),
    Parameter("neck_opens", "s", 0.0, least=0.0, path="neck.opens", meaning="Time at which the neck opens"),
    Parameter(
        "neck_closes",
        "s",
        NEVER,
        least=0.0,
        path="neck.closes",
        meaning="Time at which the neck closes; never when missing",
    ),
    Parameter(
        "leak",
        "m^2",
        0.0,
        least=0.0,
        most=FAR,
        path="inflation.leak",
        meaning='Area of the leak through pores and pinholes, which gives no thrust, of kind "gas"',
    ),
)


@wp.func
def neck_opening(neck_diameter: float, neck_discharge: float, neck_opens: float, neck_closes: float, time: float):
    """Return C_d A of a neck [m^2], 0 while it is shut."""
    area = wp.static(0.25 * math.pi) * neck_diameter * neck_diameter
    return wp.where(time >= neck_opens and time < neck_closes, neck_discharge * area, 0.0)


@wp.func
def nozzle(pressure: float, behind: float, gamma: float):
    """Return the flow of a gas over that of Bernoulli's law, and its thrust over 2 C_d A p.

    With p_0 behind the opening, p = p_0 - p_air, and in the throat p_t = p_0 (1 - x), which is p_air, or where the gas
    is as fast as sound p_0 (2 / (k + 1))^(k / (k - 1)), the gas has the density rho (1 - x)^(1 / k) there, and

        u^2 / 2 = k / (k - 1) (1 - (1 - x)^((k - 1) / k)) p_0 / rho = e x p_0 / rho

    It pushes by its momentum, and by the rest of the pressure: C_d A (rho_t u^2 + p_t - p_air).

    Args:
        pressure: p, at least 0 [Pa].
        behind: p_0 [Pa].
        gamma: k, at least `ADIABATIC`.
    """
    exponent = wp.max(gamma, ADIABATIC)
    colder = 1.0 - 1.0 / exponent
    at_speed_of_sound = 1.0 - power(2.0 / (exponent + 1.0), 1.0 / colder)
    drop = wp.clamp(pressure / behind, 0.0, 1.0)
    part = wp.min(at_speed_of_sound / wp.max(drop, LEAST_FLOW), 1.0)
    x = part * drop
    series = 1.0 + 0.5 * (1.0 - colder) * x * (1.0 + (2.0 - colder) / 3.0 * x * (1.0 + 0.25 * (3.0 - colder) * x))
    e = wp.where(x < SLIGHT, series, (1.0 - power(1.0 - x, colder)) / wp.max(colder * x, 0.1 * SLIGHT))
    density = power(1.0 - x, 1.0 / exponent)
    return wp.vec2(density * wp.sqrt(e * part), density * e * part + 0.5 * (1.0 - part))


@wp.func
def thrust(opening: float, pressure: float, gamma: float, air_pressure: float):
    """Return the thrust of a jet [N], 0 while air is drawn in, see `nozzle`."""
    above = wp.max(pressure, 0.0)
    return 2.0 * opening * above * nozzle(above, air_pressure + above, gamma)[1]


@wp.func
def orifice_flow(
    opening: float, density: float, molar_volume: float, pressure: float, softness: float, step_seconds: float
):
    """Return the flow of Bernoulli's law [mol/s] from a gauge pressure p >= 0 [Pa], by an implicit step.

    The pressure at the end of the step is p less `softness` [Pa/mol] for all that has flowed:

        q = C_d A sqrt(2 (p - s h q) / rho) / v

    with v the volume of a mole [m^3/mol]. It is stable at any step, and empties nothing beyond p = 0.
    """
    squared = 2.0 * opening * opening / wp.max(density * molar_volume * molar_volume, LEAST_FLOW)
    held_back = squared * softness * step_seconds
    root = wp.sqrt(wp.max(held_back * held_back + 4.0 * squared * pressure, LEAST_FLOW))
    return 2.0 * squared * pressure / (held_back + root)


@wp.func
def vent_flow(
    flow: float,
    pressure: float,
    taken: float,
    slope: float,
    step_seconds: float,
    opening: float,
    most: float,
    gamma: float,
    molar_mass: float,
    air_pressure: float,
    air_temperature: float,
    air_density: float,
):
    """Return the flow out of a balloon [mol/s], negative if air comes in, by the pressure at the end of the step.

    Then how much faster free volume leaves by that [m^3/s] than by the flow that was believed before.

    Args:
        flow: that one [mol/s].
        pressure: with it, above the air's [Pa].
        taken: free volume of a mole of the gas [m^3/mol], which takes it along.
        slope: rise of the pressure in the step with free volume [Pa/m^3].
        opening: C_d A of all [m^2].
        most: largest flow out [mol/s], before the balloon is flat.
    """
    here = wp.max(air_pressure + pressure, THINNEST * STANDARD_PRESSURE)
    brought = throttled(molar_volume(STANDARD_PRESSURE, air_temperature), STANDARD_PRESSURE, here, gamma)
    before = flow * wp.where(flow > 0.0, taken, brought)
    alone = pressure + slope * step_seconds * before
    leaving = float(0.0)
    after = float(0.0)
    if alone > 0.0:
        volume = volume_at(taken, here, gamma)  # of a mole
        density = wp.max(molar_mass, THINNEST * DRY_AIR_MOLAR_MASS) / wp.max(volume, LEAST_FLOW)
        passing = opening * nozzle(alone, air_pressure + alone, gamma)[0]
        leaving = wp.min(orifice_flow(passing, density, volume, alone, slope * taken, step_seconds), most)
        after = leaving * taken
    else:
        density = density_of_air(air_pressure, air_temperature, air_density)
        volume = molar_volume(air_pressure, air_temperature)
        passing = opening * nozzle(-alone, air_pressure, ADIABATIC)[0]
        leaving = -orifice_flow(passing, density, volume, -alone, slope * brought, step_seconds)
        after = leaving * brought
    return wp.vec2(leaving, after - before)

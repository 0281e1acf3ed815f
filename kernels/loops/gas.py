"""Gas of the balloons of a world: pumps, leaks and mass, by one thread of a world."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.compose import function_here
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.air import STATE_OF_AIR
from balloon_warp.kernels.laws.empty import amount_when_flat
from balloon_warp.kernels.laws.fill import blown_in, breath_in, up_to
from balloon_warp.kernels.laws.gas import (
    STANDARD_PRESSURE,
    THINNEST,
    molar_free_volume,
    pumped_gas,
    volume_at,
)
from balloon_warp.kernels.laws.inflation import GAS
from balloon_warp.kernels.laws.orifice import SHARP_EDGE, neck_opening, thrust, vent_flow
from balloon_warp.kernels.loops.airs import air_function, warmth_function
from balloon_warp.kernels.loops.emptying import holding_function, most_that_leaves
from balloon_warp.kernels.params import numbers_reader
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world


@wp.func
def gas_in(state: WorldState, world: wp.int32, balloon: wp.int32):
    """Return the amount [mol] and free volume [m^3] of the gas in a balloon."""
    return wp.vec2d(state.gas_amounts[world, balloon], state.free_volumes[world, balloon])


@wp.func
def put_gas(state: WorldState, world: wp.int32, balloon: wp.int32, gas: wp.vec2d):
    """Set amount and free volume of the gas in a balloon."""
    state.gas_amounts[world, balloon] = gas[0]
    state.free_volumes[world, balloon] = gas[1]


@cache
def filled_function(features: Features) -> Any:
    """Return the function for the gas blown into a balloon in a substep, from its state, the air and the time."""
    columns = features.columns
    gamma_column = columns.places["gamma"]
    air = ["air_pressure", "air_temperature"]
    blown_in_here = function_here(blown_in, ["time", "step_seconds", *air], columns)
    breath_in_here = function_here(breath_in, ["step_seconds", *air], columns)
    up_to_here = function_here(up_to, ["moles", "pressure", "volume", *air], columns)
    ends = [columns.places[name] for name in ("fill_to_pressure", "fill_to_diameter")]
    to_pressure_column, to_diameter_column = ends

    @wp.func
    def filled(
        pumped: float, curved: bool, by_curve: float, pressure: float, free_volume: float, time: float,
        step_seconds: float, air_pressure: float, air_temperature: float, n: Any,
    ):  # fmt: skip
        """Return the amount of gas that is filled in [mol].

        Args:
            pumped: by keyframes [mol].
            curved: whether there is a pump with a curve, which gives `by_curve` [mol].
            free_volume: of the gas, as warm as the air there [m^3].
        """
        here = wp.max(air_pressure + pressure, THINNEST * STANDARD_PRESSURE)
        volume = volume_at(free_volume, here, n[gamma_column])
        moles = pumped + blown_in_here(time, step_seconds, air_pressure, air_temperature, n)
        if curved:
            moles += by_curve
        ends = n[to_pressure_column] > 0.0 or n[to_diameter_column] > 0.0
        if ends and not curved and pumped == 0.0:
            moles += breath_in_here(step_seconds, air_pressure, air_temperature, n)
        if ends and moles > 0.0:
            moles = up_to_here(moles, pressure, volume, air_pressure, air_temperature, n)
        return moles

    return filled


@wp.func
def curve_flow(t: Tables, balloon: wp.int32, pressure: float):
    """Return the flow of a pump against a pressure [mol/s]: linear between the curve's points, zero beyond them."""
    flow = t.pumps.flows[balloon, 0]
    for point in range(t.pumps.flows.shape[1] - 1):
        begin = t.pumps.pressures[balloon, point]
        end = t.pumps.pressures[balloon, point + 1]
        if pressure > begin and end > begin:
            part = wp.min((pressure - begin) / (end - begin), 1.0)
            flow = wp.lerp(t.pumps.flows[balloon, point], t.pumps.flows[balloon, point + 1], part)
    return wp.where(pressure > t.pumps.pressures[balloon, t.pumps.flows.shape[1] - 1], 0.0, flow)


@cache
def fill_function(features: Features) -> Any:
    """Return the function for the gas blown into a balloon in a substep, besides the pumped gas."""
    air_at, as_warm_there = air_function(features), warmth_function(features)
    filled, read_numbers = filled_function(features), numbers_reader(features.columns)

    @wp.func
    def fill(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32, pumped: float, time: float):
        """Return the amount of gas that is filled in [mol]."""
        n = read_numbers(t, world, balloon)
        air = air_at(t, state, world, balloon)
        pressure = state.pressures[world, balloon]
        free_volume = as_warm_there(t, world, balloon, float(state.free_volumes[world, balloon]), air)
        curved = t.pumps.has[balloon] > 0
        by_curve = float(0.0)
        if curved:
            by_curve = t.step_seconds * curve_flow(t, balloon, pressure)
        return filled(pumped, curved, by_curve, pressure, free_volume, time, t.step_seconds, air[0], air[1], n)

    return fill


@cache
def pump_function(features: Features) -> Any:
    """Return the function that pumps gas, or lets it out."""
    columns = features.columns
    gamma_column = columns.places["gamma"]
    temperature_column = columns.places["air_temperature"] - columns.balloon_width
    air_at = air_function(features)
    fill = fill_function(features) if features.fills else None
    holds_gas = holding_function(features)

    @wp.func
    def pump_gas(t: Tables, state: WorldState, world: wp.int32, time_in_frame: float, time: float):
        """Add the gas that is pumped in during a substep, as it begins; `inflation_ramp` has it in mol/s."""
        of_balloons = row_of_world(world, t.balloon_numbers.shape[0])
        of_world = row_of_world(world, t.world_numbers.shape[0])
        for balloon in range(t.inflation_kind.shape[0]):
            if t.inflation_kind[balloon] == GAS and holds_gas(t, state, world, balloon):
                ramp = state.inflation_ramp[world, balloon]
                moles = t.step_seconds * (ramp[0] + ramp[1] * (time_in_frame + 0.5 * t.step_seconds))
                if wp.static(fill is not None):
                    moles = fill(t, state, world, balloon, moles, time)
                air = air_at(t, state, world, balloon)
                least = amount_when_flat(t.faces.enclosed[balloon][0], air)
                gas = pumped_gas(
                    gas_in(state, world, balloon), moles, least, air[0] + state.pressures[world, balloon],
                    t.balloon_numbers[of_balloons, balloon, gamma_column],
                    t.world_numbers[of_world, temperature_column], air[1],
                )  # fmt: skip
                put_gas(state, world, balloon, gas)

    return pump_gas


@wp.func
def raise_pressure(state: WorldState, world: wp.int32, balloon: wp.int32, free_volume: float):
    """Raise the pressure by the effect of additional free volume within the substep [m^3]."""
    by = state.pressure_slopes[world, balloon] * free_volume
    load = state.inflation_loads[world, balloon]
    state.pressures[world, balloon] = state.pressures[world, balloon] + by
    state.inflation_loads[world, balloon] = wp.vec2(load[0] + by, load[1])


@cache
def vent_function(features: Features) -> tuple[Any, Any]:
    """Return functions that find and take the gas that flows out of a balloon, or the air that flows in.

    The first needs the pressures without the flow.
    """
    columns = features.columns
    gamma_column, leak_column, temperature_column = (
        columns.places[name] for name in ("gamma", "leak", "air_temperature")
    )
    air_at, as_warm_there = air_function(features), warmth_function(features)
    read_numbers, opening_of_neck = numbers_reader(columns), function_here(neck_opening, ["time"], columns)
    functions_of_laws = ["flow", "pressure", "taken", "slope", "step_seconds", "opening", "most"]
    flow_of_vent = function_here(vent_flow, [*functions_of_laws, *(row.name for row in STATE_OF_AIR)], columns)

    @wp.func
    def find_vent(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32, time: float):
        """Find the flow out of a balloon by the pressure at the end of the substep, which the flow changes."""
        n = read_numbers(t, world, balloon)
        opening = opening_of_neck(time, n) + n[leak_column]
        if wp.static(features.bursts):
            opening += SHARP_EDGE * wp.max(state.bursts[world, balloon][1], 0.0)
        air = air_at(t, state, world, balloon)
        a_mole = as_warm_there(t, world, balloon, molar_free_volume(gas_in(state, world, balloon)), air)
        most = most_that_leaves(t, state, world, balloon, air)
        flow_and_more = flow_of_vent(
            state.vent_flows[world, balloon], state.pressures[world, balloon], a_mole,
            state.pressure_slopes[world, balloon], t.step_seconds, opening, most,
            air[0], air[1], air[2], n,
        )  # fmt: skip
        state.vent_flows[world, balloon] = flow_and_more[0]
        raise_pressure(state, world, balloon, -t.step_seconds * flow_and_more[1])

    @wp.func
    def take_vented(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32, time: float):
        """Take vented gas from a balloon, and store the thrust of its jet."""
        n = read_numbers(t, world, balloon)
        air = air_at(t, state, world, balloon)
        state.thrusts[world, balloon] = thrust(
            opening_of_neck(time, n), state.pressures[world, balloon], n[gamma_column], air[0]
        )
        gas = pumped_gas(
            gas_in(state, world, balloon), -t.step_seconds * state.vent_flows[world, balloon], 0.0,
            air[0] + state.pressures[world, balloon], n[gamma_column], n[temperature_column], air[1],
        )  # fmt: skip
        put_gas(state, world, balloon, gas)

    return find_vent, take_vented


@cache
def gas_mass_function(features: Features) -> Any:
    """Return the function for the mass of a balloon's gas, with the added mass of the air around it."""
    column = features.columns.places["molar_mass"]

    @wp.func
    def gas_mass(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32):
        """Return the mass of the gas, which moves along with the balloon [kg]."""
        amount = float(state.gas_amounts[world, balloon])
        if wp.static(
            features.bursts
        ):  # air in a balloon that had a pressure until it burst is not weighed before either
            amount = wp.where(t.inflation_kind[balloon] == GAS, amount, 0.0)
        gas = amount * t.balloon_numbers[row_of_world(world, t.balloon_numbers.shape[0]), balloon, column]
        if wp.static(features.takes_air_along):
            gas += state.air_along[world, balloon]
        return gas

    return gas_mass

"""Over the balloons and tubes of a world: gas that is pumped, flows, and has mass. By one thread of a world."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.columns import Columns
from balloon_warp.kernels.laws.gas import gas_through_tube, molar_free_volume, pumped_gas, tube_flow
from balloon_warp.kernels.laws.inflation import GAS
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world
from balloon_warp.kernels.traits import Traits

SWEEPS = 8
"""through several tubes, whose flows depend on each other"""


@wp.func
def gas_in(state: WorldState, world: wp.int32, balloon: wp.int32):
    """Amount [mol] and free volume [m^3] of the gas in a balloon."""
    return wp.vec2d(state.gas_amounts[world, balloon], state.free_volumes[world, balloon])


@wp.func
def put_gas(state: WorldState, world: wp.int32, balloon: wp.int32, gas: wp.vec2d):
    """Into a balloon."""
    state.gas_amounts[world, balloon] = gas[0]
    state.free_volumes[world, balloon] = gas[1]


@cache
def pump_function(columns: Columns) -> Any:
    """The function that pumps gas, or lets it out."""
    gamma_column = columns.places["gamma"]
    pressure_column, temperature_column = (
        columns.places[name] - columns.balloon_width for name in ("air_pressure", "air_temperature")
    )

    @wp.func
    def pump_gas(t: Tables, state: WorldState, world: wp.int32, time_in_frame: float):
        """What comes in a substep, as it begins; `inflation_ramp` has it in mol/s."""
        of_balloons = row_of_world(world, t.balloon_numbers.shape[0])
        of_world = row_of_world(world, t.world_numbers.shape[0])
        for balloon in range(t.inflation_kind.shape[0]):
            if t.inflation_kind[balloon] == GAS:
                ramp = state.inflation_ramp[world, balloon]
                moles = t.step_seconds * (ramp[0] + ramp[1] * (time_in_frame + 0.5 * t.step_seconds))
                pressure = t.world_numbers[of_world, pressure_column] + state.pressures[world, balloon]
                gas = pumped_gas(
                    gas_in(state, world, balloon), moles, pressure,
                    t.balloon_numbers[of_balloons, balloon, gamma_column],
                    t.world_numbers[of_world, temperature_column],
                )  # fmt: skip
                put_gas(state, world, balloon, gas)

    return pump_gas


@wp.func
def raise_pressure(state: WorldState, world: wp.int32, balloon: wp.int32, free_volume: float):
    """By what so much more gas would do within the substep [m^3]."""
    by = state.pressure_slopes[world, balloon] * free_volume
    load = state.inflation_loads[world, balloon]
    state.pressures[world, balloon] = state.pressures[world, balloon] + by
    state.inflation_loads[world, balloon] = wp.vec2(load[0] + by, load[1])


@cache
def tubes_function(columns: Columns) -> Any:
    """The function that lets gas flow through tubes, once the loads are known that were without."""
    gamma_column = columns.places["gamma"]
    pressure_column = columns.places["air_pressure"] - columns.balloon_width

    @wp.func
    def find_flows(t: Tables, state: WorldState, world: wp.int32, conductances: wp.int32):
        """Each as the pressures at its ends will be, which change with all flows: tube by tube, several times over."""
        count = t.tubes.balloons.shape[0]
        for tube in range(count):
            state.tube_flows[world, tube] = 0.0
        for _sweep in range(wp.where(count > 1, SWEEPS, 1)):
            for tube in range(count):
                first = t.tubes.balloons[tube][0]
                second = t.tubes.balloons[tube][1]
                difference = state.pressures[world, first] - state.pressures[world, second]
                source = wp.where(difference > 0.0, first, second)
                a_mole = molar_free_volume(gas_in(state, world, source))
                softness = a_mole * (state.pressure_slopes[world, first] + state.pressure_slopes[world, second])
                flow = state.tube_flows[world, tube]
                more = tube_flow(t.tubes.conductance[conductances, tube], flow, difference, softness, t.step_seconds)
                state.tube_flows[world, tube] = flow + more
                raise_pressure(state, world, first, -t.step_seconds * more * a_mole)
                raise_pressure(state, world, second, t.step_seconds * more * a_mole)

    @wp.func
    def flow_through_tubes(t: Tables, state: WorldState, world: wp.int32):
        """Pressures, loads and gases of a substep with what flows in it."""
        find_flows(t, state, world, row_of_world(world, t.tubes.conductance.shape[0]))
        of_balloons = row_of_world(world, t.balloon_numbers.shape[0])
        of_world = row_of_world(world, t.world_numbers.shape[0])
        air_pressure = t.world_numbers[of_world, pressure_column]
        for tube in range(t.tubes.balloons.shape[0]):
            moles = t.step_seconds * state.tube_flows[world, tube]
            source = t.tubes.balloons[tube][wp.where(moles > 0.0, 0, 1)]
            sink = t.tubes.balloons[tube][wp.where(moles > 0.0, 1, 0)]
            pressures = wp.vec2(
                air_pressure + state.pressures[world, source], air_pressure + state.pressures[world, sink]
            )
            left, gained = gas_through_tube(
                gas_in(state, world, source), gas_in(state, world, sink), wp.abs(moles), pressures,
                t.balloon_numbers[of_balloons, source, gamma_column],
            )  # fmt: skip
            put_gas(state, world, source, left)
            put_gas(state, world, sink, gained)

    return flow_through_tubes


@cache
def gas_mass_function(traits: Traits) -> Any:
    """The function that weighs a balloon's gas, and the air around it that moves along."""
    column = traits.columns.places["molar_mass"]

    @wp.func
    def gas_mass(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32):
        """[kg]; it moves along with the balloon."""
        amount = float(state.gas_amounts[world, balloon])
        gas = amount * t.balloon_numbers[row_of_world(world, t.balloon_numbers.shape[0]), balloon, column]
        if wp.static(traits.takes_air_along):
            gas += state.air_along[world, balloon]
        return gas

    return gas_mass

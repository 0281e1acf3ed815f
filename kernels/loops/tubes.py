"""Gas that flows through the tubes and openings of a world, by one thread."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.gas import molar_free_volume
from balloon_warp.kernels.laws.tubes import flow_and_fall, gas_through_tube
from balloon_warp.kernels.loops.airs import air_function, warmth_function
from balloon_warp.kernels.loops.emptying import holding_function, most_that_leaves
from balloon_warp.kernels.loops.gas import gas_in, put_gas, raise_pressure, vent_function
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world

SWEEPS = 8
"""Number of sweeps over tubes whose flows depend on each other"""


@cache
def tube_functions(features: Features) -> tuple[Any, Any]:
    """Return functions that find the flow of a tube, and that let its gas flow."""
    gamma_column = features.columns.places["gamma"]
    air_at, as_warm_there = air_function(features), warmth_function(features)

    @wp.func
    def find_flow(t: Tables, state: WorldState, world: wp.int32, tube: wp.int32):
        """Find the flow of a tube by the pressures at its ends after the step."""
        first = t.tubes.balloons[tube][0]
        second = t.tubes.balloons[tube][1]
        pressures = wp.vec2(state.pressures[world, first], state.pressures[world, second])
        source = wp.where(pressures[0] - pressures[1] > 0.0, first, second)
        a_mole = molar_free_volume(gas_in(state, world, source))
        moles = wp.vec2(
            as_warm_there(t, world, first, a_mole, air_at(t, state, world, first)),
            as_warm_there(t, world, second, a_mole, air_at(t, state, world, second)),
        )
        most = wp.vec2(
            most_that_leaves(t, state, world, first, air_at(t, state, world, first)),
            most_that_leaves(t, state, world, second, air_at(t, state, world, second)),
        )
        slopes = wp.vec2(state.pressure_slopes[world, first], state.pressure_slopes[world, second])
        conductance = t.tubes.conductance[row_of_world(world, t.tubes.conductance.shape[0]), tube]
        flow = state.tube_flows[world, tube]
        found = flow_and_fall(flow, pressures, slopes, moles, most, conductance, t.step_seconds)
        state.tube_flows[world, tube] = found[0]
        raise_pressure(state, world, first, found[1])
        raise_pressure(state, world, second, found[2])

    @wp.func
    def let_gas_flow(t: Tables, state: WorldState, world: wp.int32, tube: wp.int32):
        """Let the gas of a tube's flow through."""
        moles = t.step_seconds * state.tube_flows[world, tube]
        source = t.tubes.balloons[tube][wp.where(moles > 0.0, 0, 1)]
        sink = t.tubes.balloons[tube][wp.where(moles > 0.0, 1, 0)]
        air = wp.vec2(air_at(t, state, world, source)[0], air_at(t, state, world, sink)[0])
        pressures = air + wp.vec2(state.pressures[world, source], state.pressures[world, sink])
        left, gained = gas_through_tube(
            gas_in(state, world, source), gas_in(state, world, sink), wp.abs(moles), pressures,
            t.balloon_numbers[row_of_world(world, t.balloon_numbers.shape[0]), source, gamma_column],
        )  # fmt: skip
        put_gas(state, world, source, left)
        put_gas(state, world, sink, gained)

    return find_flow, let_gas_flow


@wp.func
def sweeps_of_tubes(tubes: wp.int32, vents: bool):
    """Return the number of sweeps over tubes, and over openings beside them."""
    return wp.where(tubes > 1 or (vents and tubes > 0), SWEEPS, 1)


@cache
def flows_function(features: Features) -> Any:
    """Return the function that exchanges gas through tubes and openings, from the loads without flow."""
    find_vent, take_vented = vent_function(features) if features.vents else (None, None)
    find_flow, let_gas_flow = tube_functions(features)
    holds_gas = holding_function(features)

    @wp.func
    def find_flows(t: Tables, state: WorldState, world: wp.int32, time: float):
        """Find all flows and pressures, which depend on each other, in several sweeps."""
        count = t.tubes.balloons.shape[0]
        for tube in range(count):
            state.tube_flows[world, tube] = 0.0
        sweeps = sweeps_of_tubes(count, wp.static(features.vents))
        if wp.static(features.vents):
            for balloon in range(t.inflation_kind.shape[0]):
                state.vent_flows[world, balloon] = 0.0
        for _sweep in range(sweeps):
            for tube in range(count):
                find_flow(t, state, world, tube)
            if wp.static(features.vents):
                for balloon in range(t.inflation_kind.shape[0]):
                    if holds_gas(t, state, world, balloon):
                        find_vent(t, state, world, balloon, time)

    @wp.func
    def let_gases_flow(t: Tables, state: WorldState, world: wp.int32, time: float):
        """Apply a substep's flows to pressures, loads and gases."""
        find_flows(t, state, world, time)
        for tube in range(t.tubes.balloons.shape[0]):
            let_gas_flow(t, state, world, tube)
        if wp.static(features.vents):
            for balloon in range(t.inflation_kind.shape[0]):
                if holds_gas(t, state, world, balloon):
                    take_vented(t, state, world, balloon, time)

    return let_gases_flow

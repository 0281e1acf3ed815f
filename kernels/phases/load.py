"""Pressure of a balloon's gas, from its swelling without pressure."""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.derived import nothing
from balloon_warp.kernels.adjoints.gas import load_backwards, note_backwards
from balloon_warp.kernels.clock import ramp_at
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.crushed import NO_INSIDE
from balloon_warp.kernels.laws.gas import Swelling
from balloon_warp.kernels.laws.inflation import GAS, NORMAL_FORCE, PRESSURE
from balloon_warp.kernels.loops.emptying import holding_function
from balloon_warp.kernels.loops.gas_load import load_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, WorldState


@phase(
    "balloon", {"gas": wp.vec2}, when=lambda features: features.gas, light=True,
    once=lambda features: not features.gas_changes, adjoint=nothing,
)  # fmt: skip
def hold(features: Features, look: Look) -> Any:
    """Read the gas in a balloon: its amount [mol], and its free volume [m^3]."""

    @wp.func
    def hold(state: WorldState, world: wp.int32, balloon: wp.int32):
        return wp.vec2(float(state.gas_amounts[world, balloon]), float(state.free_volumes[world, balloon]))

    return hold


@phase("balloon", {"gas_load": wp.vec4}, when=lambda features: features.gas, adjoint=load_backwards)
def find_load(features: Features, look: Look) -> Any:
    """Find the pressure of the gas."""
    load_of_balloon, holds_gas = load_function(features), holding_function(features)

    @wp.func
    def load_of_gas(t: Tables, balloon: wp.int32, swelling: Swelling, gas: wp.vec2, numbers: Any):
        return load_of_balloon(GAS, 0.0, swelling, gas, t.step_seconds, t.faces.enclosed[balloon], numbers)

    @wp.func
    def load_of_any(
        t: Tables,
        state: WorldState,
        world: wp.int32,
        balloon: wp.int32,
        time_in_frame: float,
        swelling: Swelling,
        gas: wp.vec2,
        numbers: Any,
    ):
        kind = t.inflation_kind[balloon]
        given = ramp_at(state, world, balloon, time_in_frame)
        enclosed = t.faces.enclosed[balloon]
        if wp.static(features.bursts):
            if holds_gas(t, state, world, balloon):
                kind = GAS
            elif state.bursts[world, balloon][0] >= 0.0:
                kind = PRESSURE
                given = 0.0  # it is open
                enclosed = wp.vec2(NO_INSIDE, enclosed[1])
        return load_of_balloon(kind, given, swelling, gas, t.step_seconds, enclosed, numbers)

    return load_of_gas if features.balloons == 1 and not (features.bursts or features.crushes) else load_of_any


@phase("balloon", when=lambda features: features.gas, adjoint=note_backwards)
def note(features: Features, look: Look) -> Any:
    """Note the pressure in the state."""

    @wp.func
    def note(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32, gas_load: wp.vec4):
        if t.inflation_kind[balloon] != NORMAL_FORCE:
            state.pressures[world, balloon] = gas_load[0]
            state.inflation_loads[world, balloon] = wp.vec2(gas_load[1], gas_load[2])
            if wp.static(features.gas_flows):
                state.pressure_slopes[world, balloon] = gas_load[3]

    return note

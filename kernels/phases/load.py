"""The pressure of a balloon's gas, of how it would swell without."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.derived import nothing
from balloon_warp.kernels.adjoints.gas import load_backwards, note_backwards
from balloon_warp.kernels.clock import ramp_at
from balloon_warp.kernels.laws.gas import Swelling
from balloon_warp.kernels.laws.inflation import GAS, NORMAL_FORCE, PRESSURE
from balloon_warp.kernels.loops.emptying import holding_function
from balloon_warp.kernels.loops.gas_load import load_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits


@cache
def note_function(traits: Traits) -> Any:
    """Make the function that notes a load in the state."""

    @wp.func
    def note_load(state: WorldState, world: wp.int32, balloon: wp.int32, load: wp.vec4):
        """Store the load of a balloon, in one thread."""
        state.pressures[world, balloon] = load[0]
        state.inflation_loads[world, balloon] = wp.vec2(load[1], load[2])
        if wp.static(traits.gas_flows):
            state.pressure_slopes[world, balloon] = load[3]

    return note_load


@phase(
    "balloon", {"gas": wp.vec2}, when=lambda traits: traits.gas, light=True,
    once=lambda traits: not traits.gas_changes, adjoint=nothing,
)  # fmt: skip
def hold(traits: Traits, look: Look) -> Any:
    """Read what a balloon holds: amount of gas [mol], and its free volume [m^3]."""

    @wp.func
    def hold(state: WorldState, world: wp.int32, balloon: wp.int32):
        return wp.vec2(float(state.gas_amounts[world, balloon]), float(state.free_volumes[world, balloon]))

    return hold


@phase("balloon", {"gas_load": wp.vec4}, when=lambda traits: traits.gas, adjoint=load_backwards)
def find_load(traits: Traits, look: Look) -> Any:
    """Find the pressure of the gas."""
    load_of_balloon, holds_gas = load_function(traits), holding_function(traits)

    @wp.func
    def load_of_gas(t: Tables, swelling: Swelling, gas: wp.vec2, numbers: Any):
        return load_of_balloon(GAS, 0.0, swelling, gas[0], gas[1], t.step_seconds, numbers)

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
        if wp.static(traits.bursts):
            if holds_gas(t, state, world, balloon):
                kind = GAS
            elif state.bursts[world, balloon][0] >= 0.0:
                kind = PRESSURE
                given = 0.0  # it is open
        return load_of_balloon(kind, given, swelling, gas[0], gas[1], t.step_seconds, numbers)

    return load_of_gas if traits.balloons == 1 and not traits.bursts else load_of_any


@phase("balloon", when=lambda traits: traits.gas, adjoint=note_backwards)
def note(traits: Traits, look: Look) -> Any:
    """Note the pressure in the state."""
    note_load = note_function(traits)

    @wp.func
    def note(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32, gas_load: wp.vec4):
        if t.inflation_kind[balloon] != NORMAL_FORCE:
            note_load(state, world, balloon, gas_load)

    return note

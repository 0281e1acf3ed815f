"""Adjoints of gas that comes and goes: pumps and fills as a substep begins, necks and leaks as its pressure is known.

Balloons carry the gas from substep to substep, and so its bar. A substep's values of it are recomputed.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.vents import product_of, vent_functions
from balloon_warp.kernels.clock import time_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.frames.backwards import Bars, numbers_adder
from balloon_warp.kernels.laws.empty import amount_when_flat
from balloon_warp.kernels.laws.gas import pumped_gas
from balloon_warp.kernels.laws.inflation import GAS
from balloon_warp.kernels.loops.gas import curve_flow, filled_function, gas_in, gas_mass_function, pump_function
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.params import numbers_reader
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working

A_PASCAL = wp.constant(1.0)
"""Half of the difference of pressures by which the slope of a pump's curve is found [Pa]"""


@cache
def flow_adjoint(features: Features) -> Any:
    """Return the function that runs the flow through necks and leaks backwards."""
    flow_through, left_by = vent_functions(features)

    @wp.func
    def work_of_flow(
        gas_load: wp.vec4, gas: wp.vec2, mesh_volume: float, time: float, step_seconds: float, n: Any, bar: wp.vec4,
        gas_bar: wp.vec2,
    ):  # fmt: skip
        found = flow_through(0.0, gas_load[0], gas_load[3], gas, mesh_volume, time, step_seconds, n)
        fallen = gas_load[3] * step_seconds * found[1]
        pressure = gas_load[0] - fallen
        left = left_by(wp.vec2d(gas), found[0], pressure, step_seconds, n)
        loads = pressure * bar[0] + (gas_load[1] - fallen) * bar[1] + gas_load[2] * bar[2]
        return loads + product_of(left, gas_bar)

    @wp.func
    def flow_backwards(
        t: Tables, balloon: wp.int32, time: float, gas_load: wp.vec4, gas: wp.vec2, numbers: Any, bar: wp.vec4,
        gas_after_bar: wp.vec2,
    ):  # fmt: skip
        by_load, by_gas, _volume, _time, _step, by_n, _bar, _gas_bar = wp.grad(work_of_flow)(
            gas_load, gas, t.faces.enclosed[balloon][0], time, t.step_seconds, numbers, bar, gas_after_bar
        )
        return by_load, by_gas, by_n

    return flow_backwards


@cache
def pump_again_kernel(features: Features) -> Any:
    """Return the kernel that recomputes amount and mass of the gas in a substep."""
    pump, gas_mass = pump_function(features), gas_mass_function(features)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def pump_again(t: Tables, state: WorldState, working: Working, time_in_frame: float):
        """Pump gas in, or let it out; a thread a world."""
        world = wp.tid()
        pump(t, state, world, time_in_frame, time_of(t, state.frame, time_in_frame))
        for balloon in range(t.inflation_kind.shape[0]):
            working.gas_masses[world, balloon] = gas_mass(t, state, world, balloon)

    return pump_again


@cache
def _pump_work(features: Features) -> Any:
    columns = features.columns
    gamma, air_pressure, temperature = (columns.places[name] for name in ("gamma", "air_pressure", "air_temperature"))
    filled = filled_function(features) if features.fills else None

    @wp.func
    def work_of_pump(
        gas: wp.vec2d, pumped: float, curved: bool, by_curve: float, pressure: float, mesh_volume: float, time: float,
        step_seconds: float, n: Any, bar: wp.vec2,
    ):  # fmt: skip
        moles = pumped
        if wp.static(filled is not None):
            moles = filled(
                pumped, curved, by_curve, pressure, float(gas[1]), time, step_seconds, n[air_pressure],
                n[temperature], n,
            )  # fmt: skip
        flat = amount_when_flat(mesh_volume, wp.vec3(n[air_pressure], n[temperature], 0.0))
        after = pumped_gas(gas, moles, flat, n[air_pressure] + pressure, n[gamma], n[temperature], n[temperature])
        return product_of(after, bar)

    return work_of_pump


@cache
def pump_back_kernel(features: Features, columns: tuple[int, ...]) -> Any:
    """Return the kernel that runs pumps backwards, once all else of a substep has."""
    work_of_pump, read_numbers = _pump_work(features), numbers_reader(features.columns)
    add_numbers, molar_mass = numbers_adder(columns), features.columns.places["molar_mass"]
    fills = features.fills

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def pump_back(t: Tables, state: WorldState, amounts: wp.array2d[wp.float64], time_in_frame: float, bars: Bars):
        """Turn the bar of the gas in a substep into that before; a thread a (world, balloon).

        Args:
            state: with the gas and pressure before.
            amounts: of gas in the substep.
        """
        world, balloon = wp.tid()
        mass_bar = float(0.0)
        for particle in range(t.particles.offsets[balloon], t.particles.offsets[balloon + 1]):
            mass_bar += bars.gas_masses[world, particle]
            bars.gas_masses[world, particle] = 0.0
        bars.gas_masses_of_balloons[world, balloon] = bars.gas_masses_of_balloons[world, balloon] + mass_bar
        bars.pressures[world, balloon] = 0.0
        if t.inflation_kind[balloon] != GAS:
            return
        n = read_numbers(t, world, balloon)
        bar = bars.gas[world, balloon] + wp.vec2(mass_bar * n[molar_mass], 0.0)
        middle = time_in_frame + 0.5 * t.step_seconds
        ramp = state.inflation_ramp[world, balloon]
        pressure = state.pressures[world, balloon]
        curved = bool(False)
        by_curve = float(0.0)
        steepness = float(0.0)
        if wp.static(fills):
            curved = t.pumps.has[balloon] > 0
            if curved:
                by_curve = t.step_seconds * curve_flow(t, balloon, pressure)
                rise = curve_flow(t, balloon, pressure + A_PASCAL) - curve_flow(t, balloon, pressure - A_PASCAL)
                steepness = t.step_seconds * rise / (2.0 * A_PASCAL)
        by_gas, by_pumped, _has, by_curved, by_pressure, _volume, _time, _step, by_n, _bar = wp.grad(work_of_pump)(
            gas_in(state, world, balloon), t.step_seconds * (ramp[0] + ramp[1] * middle), curved, by_curve, pressure,
            t.faces.enclosed[balloon][0], time_of(t, state.frame, time_in_frame), t.step_seconds, n, bar,
        )  # fmt: skip
        bars.gas[world, balloon] = wp.vec2(float(by_gas[0]), float(by_gas[1]))
        bars.pressures[world, balloon] = by_pressure + by_curved * steepness
        keyed = by_pumped * t.step_seconds
        bars.keyed_of_balloons[world, balloon] = bars.keyed_of_balloons[world, balloon] + keyed * wp.vec2(1.0, middle)
        by_n[molar_mass] += mass_bar * float(amounts[world, balloon])
        add_numbers(bars.numbers_of_balloons, world, balloon, by_n)

    return pump_back

"""Adjoint of gas that flows through tubes, and through necks and leaks beside them: a thread a world.

Flows and pressures are found again in sweeps, each of which is kept, and so are the gases as each tube then moves its
part. Frozen is from which end gas flows.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.vents import product_of, vents_back_functions
from balloon_warp.kernels.clock import time_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.frames.backwards import Bars, numbers_adder
from balloon_warp.kernels.laws.empty import amount_when_flat
from balloon_warp.kernels.laws.inflation import GAS
from balloon_warp.kernels.laws.tubes import flow_and_fall, gas_through_tube
from balloon_warp.kernels.loops.gas import gas_in, vent_function
from balloon_warp.kernels.loops.tubes import sweeps_of_tubes, tube_functions
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.params import numbers_reader
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world


@wp.struct
class TubeBars:
    """Derivatives by the flow of gas through tubes, and the records of a substep that is found again."""

    loads: wp.array2d[wp.vec2]
    """Derivatives by the load that each particle reads, shape (W, P)"""
    pressures: wp.array2d[float]
    """Derivatives by pressures and loads after the flow, shape (W, B)"""
    slopes: wp.array2d[float]
    """Derivatives by how fast pressures rise with the free volume, shape (W, B)"""
    flows: wp.array2d[float]
    """Derivatives by flows, shape (W, T)"""
    vents: wp.array2d[float]
    """Derivatives by flows through necks and leaks beside tubes, shape (W, B)"""
    conductances: wp.array2d[wp.float64]
    """Sums of the derivatives by each conductance since they were last taken, shape (W, T)"""
    swept: wp.array2d[wp.vec3]
    """Flow and pressures at both ends before each step of a sweep, shape (W, sweeps * (T + B))"""
    moved: wp.array3d[wp.vec2d]
    """Gases of balloons before each tube moves its part, and after the last, shape (W, T + 1, B)"""


@cache
def work_functions(features: Features) -> tuple[Any, Any]:
    """Return the functions for a tube's flow, and for the gases after it, times their bars; Warp derives them."""
    gamma, air_pressure, temperature = (
        features.columns.places[name] for name in ("gamma", "air_pressure", "air_temperature")
    )

    @wp.func
    def work_of_flow(
        swept: wp.vec3, slopes: wp.vec2, one: wp.vec2, other: wp.vec2, volumes: wp.vec2, conductance: float,
        step_seconds: float, n: Any, bar: wp.vec3,
    ):  # fmt: skip
        air = wp.vec3(n[air_pressure], n[temperature], 0.0)
        most = wp.vec2(
            wp.max(one[0] - amount_when_flat(volumes[0], air), 0.0) / step_seconds,
            wp.max(other[0] - amount_when_flat(volumes[1], air), 0.0) / step_seconds,
        )
        mole = wp.where(swept[1] > swept[2], one[1] / one[0], other[1] / other[0])
        pressures = wp.vec2(swept[1], swept[2])
        found = flow_and_fall(swept[0], pressures, slopes, wp.vec2(mole, mole), most, conductance, step_seconds)
        ends = wp.vec3(found[0], swept[1] + slopes[0] * found[1], swept[2] + slopes[1] * found[2])
        return wp.dot(ends, bar)

    @wp.func
    def work_of_gases(
        source: wp.vec2d, sink: wp.vec2d, moles: float, pressures: wp.vec2, n: Any, left_bar: wp.vec2,
        gained_bar: wp.vec2,
    ):  # fmt: skip
        air = wp.vec2(n[air_pressure], n[air_pressure])
        left, gained = gas_through_tube(source, sink, moles, air + pressures, n[gamma])
        return product_of(left, left_bar) + product_of(gained, gained_bar)

    return work_of_flow, work_of_gases


@wp.func
def sum_of_loads(t: Tables, bars: TubeBars, world: wp.int32, balloon: wp.int32):
    """Return the derivative by the constant part of a balloon's load."""
    total = float(0.0)
    for particle in range(t.particles.offsets[balloon], t.particles.offsets[balloon + 1]):
        total += bars.loads[world, particle][0]
    return total


@wp.func
def steps_of_sweep(t: Tables, vents: bool):
    """Return the number of tubes, and of balloons that may have openings beside them."""
    return t.tubes.balloons.shape[0] + wp.where(vents, t.inflation_kind.shape[0], 0)


@cache
def back_functions(features: Features, columns: tuple[int, ...]) -> tuple[Any, Any]:
    """Return the functions that run backwards a step of a sweep, and the gas's move through a tube after it."""
    work_of_flow, work_of_gases = work_functions(features)
    read_numbers, add_numbers = numbers_reader(features.columns), numbers_adder(columns)

    @wp.func
    def flow_back(
        t: Tables, state: WorldState, bars: TubeBars, of_frame: Bars, world: wp.int32, tube: wp.int32, step: wp.int32
    ):
        ends = t.tubes.balloons[tube]
        row = row_of_world(world, t.tubes.conductance.shape[0])
        slopes = wp.vec2(state.pressure_slopes[world, ends[0]], state.pressure_slopes[world, ends[1]])
        bar = wp.vec3(bars.flows[world, tube], bars.pressures[world, ends[0]], bars.pressures[world, ends[1]])
        by_swept, by_slopes, by_one, by_other, _volumes, by_conductance, _step, by_n, _bar = wp.grad(work_of_flow)(
            bars.swept[world, step], slopes, wp.vec2(bars.moved[world, 0, ends[0]]),
            wp.vec2(bars.moved[world, 0, ends[1]]), wp.vec2(t.faces.enclosed[ends[0]][0], t.faces.enclosed[ends[1]][0]),
            t.tubes.conductance[row, tube], t.step_seconds, read_numbers(t, world, ends[0]), bar,
        )  # fmt: skip
        bars.flows[world, tube] = by_swept[0]
        bars.conductances[world, tube] = bars.conductances[world, tube] + wp.float64(by_conductance)
        for end in range(2):
            bars.pressures[world, ends[end]] = by_swept[end + 1]
            bars.slopes[world, ends[end]] = bars.slopes[world, ends[end]] + by_slopes[end]
        of_frame.gas[world, ends[0]] = of_frame.gas[world, ends[0]] + by_one
        of_frame.gas[world, ends[1]] = of_frame.gas[world, ends[1]] + by_other
        add_numbers(of_frame.numbers_of_balloons, world, ends[0], by_n)

    @wp.func
    def move_back(t: Tables, state: WorldState, bars: TubeBars, of_frame: Bars, world: wp.int32, tube: wp.int32):
        moles = t.step_seconds * state.tube_flows[world, tube]
        source = t.tubes.balloons[tube][wp.where(moles > 0.0, 0, 1)]
        sink = t.tubes.balloons[tube][wp.where(moles > 0.0, 1, 0)]
        pressures = wp.vec2(state.pressures[world, source], state.pressures[world, sink])
        by_source, by_sink, by_moles, by_pressures, by_n, _left, _gained = wp.grad(work_of_gases)(
            bars.moved[world, tube, source], bars.moved[world, tube, sink], wp.abs(moles), pressures,
            read_numbers(t, world, source), of_frame.gas[world, source], of_frame.gas[world, sink],
        )  # fmt: skip
        of_frame.gas[world, source] = wp.vec2(float(by_source[0]), float(by_source[1]))
        of_frame.gas[world, sink] = wp.vec2(float(by_sink[0]), float(by_sink[1]))
        bars.pressures[world, source] = bars.pressures[world, source] + by_pressures[0]
        bars.pressures[world, sink] = bars.pressures[world, sink] + by_pressures[1]
        bars.flows[world, tube] = t.step_seconds * wp.where(moles > 0.0, by_moles, -by_moles)
        add_numbers(of_frame.numbers_of_balloons, world, source, by_n)

    return flow_back, move_back


@cache
def again_function(features: Features) -> Any:
    """Return the function that lets gas flow again, and keeps the states on its way."""
    find_flow, let_gas_flow = tube_functions(features)
    find_vent = vent_function(features)[0] if features.vents else None

    @wp.func
    def flow_again(t: Tables, state: WorldState, bars: TubeBars, world: wp.int32, time: float):
        """Let gas flow, and return the steps of all sweeps: of tubes, and of openings after them."""
        count = t.tubes.balloons.shape[0]
        wide = steps_of_sweep(t, wp.static(features.vents))
        steps = wide * sweeps_of_tubes(count, wp.static(features.vents))
        for step in range(steps):
            tube = step - (step // wide) * wide
            if tube < count:
                ends = t.tubes.balloons[tube]
                flow = wp.where(step < wide, 0.0, state.tube_flows[world, tube])
                state.tube_flows[world, tube] = flow
                pressures = wp.vec2(state.pressures[world, ends[0]], state.pressures[world, ends[1]])
                bars.swept[world, step] = wp.vec3(flow, pressures[0], pressures[1])
                find_flow(t, state, world, tube)
            else:
                if wp.static(features.vents):
                    balloon = tube - count
                    if t.inflation_kind[balloon] == GAS:
                        flow = wp.where(step < wide, 0.0, state.vent_flows[world, balloon])
                        state.vent_flows[world, balloon] = flow
                        bars.swept[world, step] = wp.vec3(flow, state.pressures[world, balloon], 0.0)
                        find_vent(t, state, world, balloon, time)
        for tube in range(count + 1):
            for balloon in range(t.inflation_kind.shape[0]):
                bars.moved[world, tube, balloon] = gas_in(state, world, balloon)
            if tube < count:
                let_gas_flow(t, state, world, tube)
        return steps

    return flow_again


@cache
def tubes_back_kernel(features: Features, columns: tuple[int, ...]) -> Any:
    """Return the kernel that runs the flow through tubes backwards, once all that reads pressures has.

    Args:
        columns: of the numbers that are derived by.
    """
    flow_again = again_function(features)
    flow_back, move_back = back_functions(features, columns)
    vent_back, loss_back = vents_back_functions(features, numbers_adder(columns), numbers_reader(features.columns))

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def turn_tubes_back(
        t: Tables, state: WorldState, loads: wp.array2d[wp.vec4], time_in_frame: float, bars: TubeBars, of_frame: Bars
    ):  # fmt: skip
        """Turn the derivatives by pressures and gases after the flow into those before; a thread a world.

        Args:
            state: with the gas before the flow, and arrays that change as it flows again.
            loads: pressure, load and slope of each balloon before.
        """
        world = wp.tid()
        for balloon in range(t.inflation_kind.shape[0]):
            state.pressures[world, balloon] = loads[world, balloon][0]
            state.pressure_slopes[world, balloon] = loads[world, balloon][3]
            bars.slopes[world, balloon] = 0.0
            by_load = sum_of_loads(t, bars, world, balloon)
            bars.pressures[world, balloon] = of_frame.pressures[world, balloon] + by_load
        time = time_of(t, state.frame, time_in_frame)
        steps = flow_again(t, state, bars, world, time)
        count = t.tubes.balloons.shape[0]
        wide = steps_of_sweep(t, wp.static(features.vents))
        if wp.static(features.vents):
            for balloon in range(t.inflation_kind.shape[0]):
                if t.inflation_kind[balloon] == GAS:
                    loss_back(t, state, bars, of_frame, world, balloon)
        for number in range(count):
            move_back(t, state, bars, of_frame, world, count - 1 - number)
        for number in range(steps):
            step = steps - 1 - number
            tube = step - (step // wide) * wide
            if tube < count:
                flow_back(t, state, bars, of_frame, world, tube, step)
            else:
                if wp.static(features.vents):
                    if t.inflation_kind[tube - count] == GAS:
                        vent_back(t, state, bars, of_frame, world, tube - count, step, time)
        for balloon in range(t.inflation_kind.shape[0]):  # derivatives by the load alone are added where that is found
            of_frame.pressures[world, balloon] = bars.pressures[world, balloon] - sum_of_loads(t, bars, world, balloon)

    return turn_tubes_back

"""Adjoints of gas pressure, pumps, leaks, jets and tubes.

Adjoint of the thrust of a neck's jet, along the unit vector across the neck that its edges enclose. Each particle gives
its share, by the pressure there and the neck's own numbers. Particles of the rim turn the vector: they gather its bar
from all shares.

Adjoint of gas that flows through tubes, and through necks and leaks beside them: a thread a world. Flows and pressures
are found again in sweeps, each of which is kept, and so are the gases as each tube then moves its part. Frozen is from
which end gas flows.

Adjoints of gas that comes and goes: pumps and fills as a substep begins, necks and leaks as its pressure is known.
Balloons carry the gas from substep to substep, and so its bar. A substep's values of it are recomputed.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.adjoints.sums import Bars, numbers_adder
from balloon_warp.kernels.compose import function_here, numbers_reader, params_functions, time_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.air import density_of_air
from balloon_warp.kernels.laws.flow import neck_opening, thrust, vent_flow
from balloon_warp.kernels.laws.gas import Swelling, amount_when_flat, flow_and_fall, gas_through_tube, pumped_gas
from balloon_warp.kernels.laws.outer import GAS, NORMAL_FORCE
from balloon_warp.kernels.loops.gas import (
    curve_flow,
    filled_function,
    gas_in,
    gas_mass_function,
    load_function,
    pump_function,
    sweeps_of_tubes,
    tube_functions,
    vent_function,
)
from balloon_warp.kernels.phase import Access, Adjoint, NoAdjointError, Phase
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world
from balloon_warp.kernels.working import Working


@wp.func
def product_of(gas: wp.vec2d, bar: wp.vec2):
    """Pairing of amount and free volume with their bars."""
    return float(gas[0]) * bar[0] + float(gas[1]) * bar[1]


@cache
def vent_functions(features: Features) -> tuple[Any, Any]:
    """Functions of the flow through a balloon's openings, and of the remaining gas."""
    columns = features.columns
    gamma, leak, air_pressure, temperature, density = (
        columns.places[name] for name in ("gamma", "leak", "air_pressure", "air_temperature", "air_density")
    )
    opening_of_neck = function_here(neck_opening, ["time"], columns)
    given = ["flow", "pressure", "taken", "slope", "step_seconds", "opening", "most"]
    air = ["air_pressure", "air_temperature", "air_density"]
    flow_of_vent = function_here(vent_flow, [*given, *air], columns)

    @wp.func
    def flow_through(
        flow: float, pressure: float, slope: float, gas: wp.vec2, mesh_volume: float, time: float, step_seconds: float,
        n: Any,
    ):  # fmt: skip
        """Return the flow, and how much faster free volume leaves than by the one before, see `vent_flow`."""
        opening = opening_of_neck(time, n) + n[leak]
        air_density = density_of_air(n[air_pressure], n[temperature], n[density])
        flat = amount_when_flat(mesh_volume, wp.vec3(n[air_pressure], n[temperature], air_density))
        most = wp.max(gas[0] - flat, 0.0) / step_seconds
        return flow_of_vent(
            flow, pressure, gas[1] / gas[0], slope, step_seconds, opening, most, n[air_pressure], n[temperature],
            air_density, n,
        )  # fmt: skip

    @wp.func
    def left_by(gas: wp.vec2d, flow: float, pressure: float, step_seconds: float, n: Any):
        """Return the gas after a flow under a gauge pressure."""
        return pumped_gas(
            gas, -step_seconds * flow, 0.0, n[air_pressure] + pressure, n[gamma], n[temperature], n[temperature]
        )

    return flow_through, left_by


@cache
def vent_pairings(features: Features) -> tuple[Any, Any]:
    """Pairings of the flow through openings beside tubes, and of the gas after it, with their bars."""
    flow_through, left_by = vent_functions(features)

    @wp.func
    def vent_pairing(
        swept: wp.vec2, slope: float, gas: wp.vec2, mesh_volume: float, time: float, step_seconds: float, n: Any,
        bar: wp.vec2,
    ):  # fmt: skip
        found = flow_through(swept[0], swept[1], slope, gas, mesh_volume, time, step_seconds, n)
        return found[0] * bar[0] + (swept[1] - slope * step_seconds * found[1]) * bar[1]

    @wp.func
    def loss_pairing(gas: wp.vec2d, flow: float, pressure: float, step_seconds: float, n: Any, bar: wp.vec2):
        return product_of(left_by(gas, flow, pressure, step_seconds, n), bar)

    return vent_pairing, loss_pairing


@cache
def vents_back_functions(features: Features, add_numbers: Any, read_numbers: Any) -> tuple[Any, Any]:
    """Adjoints of a vent's flow in a sweep, and of the loss of gas after it.

    Args:
        add_numbers: function that adds derivatives by numbers to those of a balloon.
        read_numbers: function that reads the numbers of a balloon.
    """
    vent_pairing, loss_pairing = vent_pairings(features)

    @wp.func
    def vent_back(
        t: Any, state: Any, bars: Any, of_frame: Any, world: wp.int32, balloon: wp.int32, step: wp.int32, time: float
    ):
        swept = wp.vec2(bars.swept[world, step][0], bars.swept[world, step][1])
        bar = wp.vec2(bars.vents[world, balloon], bars.pressures[world, balloon])
        by_swept, by_slope, by_gas, _volume, _time, _step, by_n, _bar = wp.grad(vent_pairing)(
            swept, state.pressure_slopes[world, balloon], wp.vec2(bars.moved[world, 0, balloon]),
            t.faces.enclosed[balloon][0], time, t.step_seconds, read_numbers(t, world, balloon), bar,
        )  # fmt: skip
        bars.vents[world, balloon] = by_swept[0]
        bars.pressures[world, balloon] = by_swept[1]
        bars.slopes[world, balloon] = bars.slopes[world, balloon] + by_slope
        of_frame.gas[world, balloon] = of_frame.gas[world, balloon] + by_gas
        add_numbers(of_frame.numbers_of_balloons, world, balloon, by_n)

    @wp.func
    def loss_back(t: Any, state: Any, bars: Any, of_frame: Any, world: wp.int32, balloon: wp.int32):
        tubes = t.tubes.balloons.shape[0]
        by_gas, by_flow, by_pressure, _step, by_n, _bar = wp.grad(loss_pairing)(
            bars.moved[world, tubes, balloon], state.vent_flows[world, balloon], state.pressures[world, balloon],
            t.step_seconds, read_numbers(t, world, balloon), of_frame.gas[world, balloon],
        )  # fmt: skip
        of_frame.gas[world, balloon] = wp.vec2(float(by_gas[0]), float(by_gas[1]))
        bars.vents[world, balloon] = by_flow
        bars.pressures[world, balloon] = bars.pressures[world, balloon] + by_pressure
        add_numbers(of_frame.numbers_of_balloons, world, balloon, by_n)

    return vent_back, loss_back


def jet_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoints of the thrust at a neck: by a particle's own share, and by the rim's places."""
    opening_of_neck = function_here(neck_opening, ["time"], features.columns)
    thrust_of = function_here(thrust, ["opening", "pressure"], features.columns)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type
    at = access.at

    @wp.func
    def across(t: Tables, points: Any, balloon: wp.int32):
        """Return twice the area vector that the edges of a neck enclose [m^2]."""
        first = t.necks.offsets[balloon]
        origin = at(points, t.necks.edges[first][0])
        out = wp.vec3()
        for edge in range(first, t.necks.offsets[balloon + 1]):
            ends = t.necks.edges[edge]
            out += wp.cross(at(points, ends[0]) - origin, at(points, ends[1]) - origin)
        return out

    @wp.func
    def share_pairing(weight: float, load: wp.vec2, height: float, time: float, n: Any, along: float):
        return -weight * thrust_of(opening_of_neck(time, n), load[0] + load[1] * height, n) * along

    @wp.func
    def own_adjoint(
        t: Tables, points: Any, params: Any, point: wp.vec3, load: wp.vec2, time: float, force_bar: wp.vec3
    ):
        load_bar = wp.vec2()
        point_bar = wp.vec3()
        params_bar = Params()
        weight = t.necks.weights[params.number]
        if weight > 0.0:
            along = wp.dot(wp.normalize(across(t, points, params.balloon)), force_bar)
            _weight, by_load, by_height, _time, by_n, _along = wp.grad(share_pairing)(
                weight, load, wp.dot(point, t.up), time, params.n, along
            )
            load_bar = by_load
            point_bar = by_height * t.up
            params_bar.n = by_n
        return force_bar, load_bar, point_bar, params_bar

    @wp.func
    def bar_of_thrust(t: Tables, points: Any, params: Any, load: wp.vec2, time: float, force_bars: Any):
        """Bar of the unit vector across the neck."""
        opening = opening_of_neck(time, params.n)
        total = wp.vec3()
        for other in range(t.particles.offsets[params.balloon], t.particles.offsets[params.balloon + 1]):
            weight = t.necks.weights[other]
            if weight > 0.0:
                pressure = load[0] + load[1] * wp.dot(at(points, other), t.up)
                total -= (weight * thrust_of(opening, pressure, params.n)) * at(force_bars, other)
        return total

    @wp.func
    def rim_adjoint(t: Tables, points: Any, params: Any, load: wp.vec2, time: float, force_bars: Any):
        """Return (after - before) x the derivative by twice the area vector, of a particle of the rim."""
        chord = wp.vec3()
        is_at_rim = bool(False)
        for edge in range(t.necks.offsets[params.balloon], t.necks.offsets[params.balloon + 1]):
            ends = t.necks.edges[edge]
            if ends[0] == params.number:
                chord += at(points, ends[1])
                is_at_rim = True
            if ends[1] == params.number:
                chord -= at(points, ends[0])
        point_bar = wp.vec3()
        if is_at_rim:
            out = across(t, points, params.balloon)
            size = wp.length(out)
            if size > 0.0:
                unit = out / size
                thrust_bar = bar_of_thrust(t, points, params, load, time, force_bars)
                point_bar = wp.cross(chord, (thrust_bar - wp.dot(thrust_bar, unit) * unit) / size)
        return point_bar

    return (Adjoint(own_adjoint, ("force", "load", "point", "params")), Adjoint(rim_adjoint, ("point",)))


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
def pairing_functions(features: Features) -> tuple[Any, Any]:
    """Pairings of a tube's flow, and of the gases after it, with their bars; Warp derives them."""
    gamma, air_pressure, temperature = (
        features.columns.places[name] for name in ("gamma", "air_pressure", "air_temperature")
    )

    @wp.func
    def flow_pairing(
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
    def gases_pairing(
        source: wp.vec2d, sink: wp.vec2d, moles: float, pressures: wp.vec2, n: Any, left_bar: wp.vec2,
        gained_bar: wp.vec2,
    ):  # fmt: skip
        air = wp.vec2(n[air_pressure], n[air_pressure])
        left, gained = gas_through_tube(source, sink, moles, air + pressures, n[gamma])
        return product_of(left, left_bar) + product_of(gained, gained_bar)

    return flow_pairing, gases_pairing


@wp.func
def sum_of_loads(t: Tables, bars: TubeBars, world: wp.int32, balloon: wp.int32):
    """Bar of the constant part of a balloon's load."""
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
    """Adjoints of a step of a sweep, and of the transfer of gas through a tube after it."""
    flow_pairing, gases_pairing = pairing_functions(features)
    read_numbers, add_numbers = numbers_reader(features.columns), numbers_adder(columns)

    @wp.func
    def flow_back(
        t: Tables, state: WorldState, bars: TubeBars, of_frame: Bars, world: wp.int32, tube: wp.int32, step: wp.int32
    ):
        ends = t.tubes.balloons[tube]
        row = row_of_world(world, t.tubes.conductance.shape[0])
        slopes = wp.vec2(state.pressure_slopes[world, ends[0]], state.pressure_slopes[world, ends[1]])
        bar = wp.vec3(bars.flows[world, tube], bars.pressures[world, ends[0]], bars.pressures[world, ends[1]])
        by_swept, by_slopes, by_one, by_other, _volumes, by_conductance, _step, by_n, _bar = wp.grad(flow_pairing)(
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
        by_source, by_sink, by_moles, by_pressures, by_n, _left, _gained = wp.grad(gases_pairing)(
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
    """Recomputation of the flow of gas that stores intermediate states."""
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
    """Backward kernel of the flow through tubes, after all readers of pressures.

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
        """Backward pass of pressures and gases through the flow; a thread a world.

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


A_PASCAL = wp.constant(1.0)
"""Half of the difference of pressures by which the slope of a pump's curve is found [Pa]"""


@cache
def flow_adjoint(features: Features) -> Any:
    """Adjoint of the flow through necks and leaks."""
    flow_through, left_by = vent_functions(features)

    @wp.func
    def flow_pairing(
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
        by_load, by_gas, _volume, _time, _step, by_n, _bar, _gas_bar = wp.grad(flow_pairing)(
            gas_load, gas, t.faces.enclosed[balloon][0], time, t.step_seconds, numbers, bar, gas_after_bar
        )
        return by_load, by_gas, by_n

    return flow_backwards


@cache
def pump_again_kernel(features: Features) -> Any:
    """Recomputation kernel of amount and mass of the gas in a substep."""
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
def _pump_pairing(features: Features) -> Any:
    columns = features.columns
    gamma, air_pressure, temperature = (columns.places[name] for name in ("gamma", "air_pressure", "air_temperature"))
    filled = filled_function(features) if features.fills else None

    @wp.func
    def pump_pairing(
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

    return pump_pairing


@cache
def pump_back_kernel(features: Features, columns: tuple[int, ...]) -> Any:
    """Backward kernel of pumps, last in a substep."""
    pump_pairing, read_numbers = _pump_pairing(features), numbers_reader(features.columns)
    add_numbers, molar_mass = numbers_adder(columns), features.columns.places["molar_mass"]
    fills = features.fills

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def pump_back(t: Tables, state: WorldState, amounts: wp.array2d[wp.float64], time_in_frame: float, bars: Bars):
        """Backward pass of the gas update; a thread a (world, balloon).

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
        by_gas, by_pumped, _has, by_curved, by_pressure, _volume, _time, _step, by_n, _bar = wp.grad(pump_pairing)(
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


def load_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoint of a balloon's pressure."""
    load_of_balloon = load_function(features)

    @wp.func
    def load_pairing(
        kind: wp.int32, given: float, swelling: Swelling, gas: wp.vec2, step_seconds: float, enclosed: wp.vec2,
        n: Any, bar: wp.vec4,
    ):  # fmt: skip
        return wp.dot(load_of_balloon(kind, given, swelling, gas, step_seconds, enclosed, n), bar)

    @wp.func
    def load_adjoint(
        t: Tables,
        balloon: wp.int32,
        keyed: float,
        swelling: Swelling,
        gas: wp.vec2,
        numbers: Any,
        gas_load_bar: wp.vec4,
    ):
        _kind, by_given, by_swelling, by_gas, _step, _enclosed, by_n, _bar = wp.grad(load_pairing)(
            t.inflation_kind[balloon], keyed, swelling, gas, t.step_seconds, t.faces.enclosed[balloon], numbers,
            gas_load_bar,
        )  # fmt: skip
        return by_given, by_swelling, by_gas, by_n

    return (Adjoint(load_adjoint, ("keyed", "swelling", "gas", "numbers")),)


@wp.func
def bar_of_noted(t: Tables, balloon: wp.int32, load_bar: wp.vec2, pressure_bar: float):
    """Return the bar of a balloon's load, which is zero where a normal force inflates."""
    bar = wp.vec4(pressure_bar, load_bar[0], load_bar[1], 0.0)
    if t.inflation_kind[balloon] == NORMAL_FORCE:
        bar = wp.vec4()
    return bar


@wp.func
def bar_of_flowing(t: Tables, balloon: wp.int32, load_bar: wp.vec2, pressure_bar: float, slope_bar: float):
    """Return the bar of a balloon's load, where gas flows through tubes."""
    return bar_of_noted(t, balloon, load_bar, pressure_bar) + wp.vec4(0.0, 0.0, 0.0, slope_bar)


def note_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoint of the recorded pressure after the flow of gas: particles and readers use it."""

    if features.tubes:
        return (Adjoint(bar_of_flowing, ("gas_load",)),)
    if not features.vents:
        return (Adjoint(bar_of_noted, ("gas_load",)),)
    flow_backwards = flow_adjoint(features)

    @wp.func
    def note_adjoint(
        t: Tables, balloon: wp.int32, time: float, gas_load: wp.vec4, gas: wp.vec2, numbers: Any, load_bar: wp.vec2,
        pressure_bar: float, gas_after_bar: wp.vec2,
    ):  # fmt: skip
        bar = bar_of_noted(t, balloon, load_bar, pressure_bar)
        gas_bar = wp.vec2()
        by_n = 0.0 * numbers
        if t.inflation_kind[balloon] == GAS:
            by_load, by_gas, by_numbers = flow_backwards(t, balloon, time, gas_load, gas, numbers, bar, gas_after_bar)
            bar = by_load
            gas_bar = by_gas - gas_after_bar  # to which it is added
            by_n = by_numbers
        return bar, gas_bar, by_n

    return (Adjoint(note_adjoint, ("gas_load", "gas", "numbers")),)


def pump_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Return no adjoint of pumps and flows: a kernel of its own runs them backwards."""
    if features.gas_meets_air:
        raise NoAdjointError("gas that comes and goes in air that varies")
    return ()

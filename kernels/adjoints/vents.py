"""Flow through necks and leaks, and the gas that it leaves: of plain values, so that Warp derives them."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.compose import function_here
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.air import density_of_air
from balloon_warp.kernels.laws.empty import amount_when_flat
from balloon_warp.kernels.laws.gas import pumped_gas
from balloon_warp.kernels.laws.orifice import neck_opening, vent_flow


@wp.func
def product_of(gas: wp.vec2d, bar: wp.vec2):
    """Return amount and free volume times their bars."""
    return float(gas[0]) * bar[0] + float(gas[1]) * bar[1]


@cache
def vent_functions(features: Features) -> tuple[Any, Any]:
    """Return the functions for the flow through a balloon's openings, and for the gas that it leaves."""
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
def vent_works(features: Features) -> tuple[Any, Any]:
    """Return the functions for a flow through openings beside tubes, and for the gas after it, times their bars."""
    flow_through, left_by = vent_functions(features)

    @wp.func
    def work_of_vent(
        swept: wp.vec2, slope: float, gas: wp.vec2, mesh_volume: float, time: float, step_seconds: float, n: Any,
        bar: wp.vec2,
    ):  # fmt: skip
        found = flow_through(swept[0], swept[1], slope, gas, mesh_volume, time, step_seconds, n)
        return found[0] * bar[0] + (swept[1] - slope * step_seconds * found[1]) * bar[1]

    @wp.func
    def work_of_loss(gas: wp.vec2d, flow: float, pressure: float, step_seconds: float, n: Any, bar: wp.vec2):
        return product_of(left_by(gas, flow, pressure, step_seconds, n), bar)

    return work_of_vent, work_of_loss


@cache
def vents_back_functions(features: Features, add_numbers: Any, read_numbers: Any) -> tuple[Any, Any]:
    """Return the functions that run backwards a vent's flow in a sweep, and the loss of gas after it.

    Args:
        add_numbers: function that adds derivatives by numbers to those of a balloon.
        read_numbers: function that reads the numbers of a balloon.
    """
    work_of_vent, work_of_loss = vent_works(features)

    @wp.func
    def vent_back(
        t: Any, state: Any, bars: Any, of_frame: Any, world: wp.int32, balloon: wp.int32, step: wp.int32, time: float
    ):
        swept = wp.vec2(bars.swept[world, step][0], bars.swept[world, step][1])
        bar = wp.vec2(bars.vents[world, balloon], bars.pressures[world, balloon])
        by_swept, by_slope, by_gas, _volume, _time, _step, by_n, _bar = wp.grad(work_of_vent)(
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
        by_gas, by_flow, by_pressure, _step, by_n, _bar = wp.grad(work_of_loss)(
            bars.moved[world, tubes, balloon], state.vent_flows[world, balloon], state.pressures[world, balloon],
            t.step_seconds, read_numbers(t, world, balloon), of_frame.gas[world, balloon],
        )  # fmt: skip
        of_frame.gas[world, balloon] = wp.vec2(float(by_gas[0]), float(by_gas[1]))
        bars.vents[world, balloon] = by_flow
        bars.pressures[world, balloon] = bars.pressures[world, balloon] + by_pressure
        add_numbers(of_frame.numbers_of_balloons, world, balloon, by_n)

    return vent_back, loss_back

"""Adjoint of the thrust of a neck's jet, along the unit vector across the neck that its edges enclose.

Each particle gives its share, by the pressure there and the neck's own numbers. Particles of the rim turn the vector:
they gather its bar from all shares.
"""

from collections.abc import Sequence
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.compose import function_here
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.orifice import neck_opening, thrust
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.phase import Look, Phase
from balloon_warp.kernels.tables import Tables


def jet_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoints of the thrust at a neck: of a particle's own share, and of the rim's places."""
    opening_of_neck = function_here(neck_opening, ["time"], features.columns)
    thrust_of = function_here(thrust, ["opening", "pressure"], features.columns)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type
    at = look.at

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
    def work_of_share(weight: float, load: wp.vec2, height: float, time: float, n: Any, along: float):
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
            _weight, by_load, by_height, _time, by_n, _along = wp.grad(work_of_share)(
                weight, load, wp.dot(point, t.up), time, params.n, along
            )
            load_bar = by_load
            point_bar = by_height * t.up
            params_bar.n = by_n
        return force_bar, load_bar, point_bar, params_bar

    @wp.func
    def worth_of_thrust(t: Tables, points: Any, params: Any, load: wp.vec2, time: float, force_bars: Any):
        """Return the derivative by the unit vector across the neck."""
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
                worth = worth_of_thrust(t, points, params, load, time, force_bars)
                point_bar = wp.cross(chord, (worth - wp.dot(worth, unit) * unit) / size)
        return point_bar

    return (Adjoint(own_adjoint, ("force", "load", "point", "params")), Adjoint(rim_adjoint, ("point",)))

"""Thrust of the jets of a balloon that is open or torn, on the particles at the opening."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.compose import function_here
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.gas_tables import NeckTable
from balloon_warp.kernels.laws.orifice import SHARP_EDGE, neck_opening, thrust
from balloon_warp.kernels.loops.areas import hole_loop
from balloon_warp.kernels.tables import Tables


@cache
def jet_loop(features: Features, at: Any) -> Any:
    """Return the function for a particle's share of its balloon's thrust."""
    opening_of_neck = function_here(neck_opening, ["time"], features.columns)
    thrust_of = function_here(thrust, ["opening", "pressure"], features.columns)

    @wp.func
    def jet(
        necks: NeckTable,
        points: Any,
        weight: float,
        balloon: wp.int32,
        load: wp.vec2,
        height: float,
        time: float,
        n: Any,
    ):
        """Force [N], inwards across the neck: its edges in turn enclose an area vector of the direction of the jet.

        Args:
            weight: the particle's part.
            load: pressure at height 0 [Pa], and its rise with height [Pa/m].
            height: of the particle [m].
        """
        force = wp.vec3()
        if weight > 0.0:
            out = wp.vec3()
            first = necks.offsets[balloon]
            origin = at(points, necks.edges[first][0])
            for edge in range(first, necks.offsets[balloon + 1]):
                ends = necks.edges[edge]
                out += wp.cross(at(points, ends[0]) - origin, at(points, ends[1]) - origin)
            pressure = load[0] + load[1] * height
            force = (-weight * thrust_of(opening_of_neck(time, n), pressure, n)) * wp.normalize(out)
        return force

    return jet


@cache
def hole_jet_loop(features: Features, at: Any) -> Any:
    """Return the function for a particle's share of the thrust of holes where its balloon is torn."""
    area_vector_of_holes = hole_loop(at)
    thrust_of = function_here(thrust, ["opening", "pressure"], features.columns)

    @wp.func
    def jet_of_holes(t: Tables, points: Any, params: Any, load: wp.vec2, point: wp.vec3):
        """Force [N]; `load` is the pressure at height 0 [Pa], and its rise with height [Pa/m]."""
        hole = area_vector_of_holes(t, points, params.world, params.number, point)
        return -thrust_of(SHARP_EDGE, load[0] + load[1] * wp.dot(point, t.up), params.n) * hole

    return jet_of_holes

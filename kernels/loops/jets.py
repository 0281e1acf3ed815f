"""Thrust of the jets of a balloon that is open or torn, on the particles at the opening."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.compose import call_of, function_from
from balloon_warp.kernels.laws.columns import Columns
from balloon_warp.kernels.laws.orifice import SHARP_EDGE, neck_opening, thrust
from balloon_warp.kernels.loops.areas import hole_loop
from balloon_warp.kernels.tables import NeckTable, Tables
from balloon_warp.kernels.traits import Traits


@cache
def opening_function(columns: Columns) -> Any:
    """Return the function for a neck's open area at a time, from the row of its balloon's numbers."""
    call = call_of(neck_opening, "neck_opening", ["time"], columns)
    source = f"def opening_of_neck(time: float, n: Any):\n    return {call}\n"
    return function_from("opening_of_neck", source, {"neck_opening": neck_opening})


@cache
def jet_loop(traits: Traits, at: Any) -> Any:
    """Return the function for a particle's share of its balloon's thrust.

    Args:
        at: the function that reads a point.
    """
    opening_of_neck = opening_function(traits.columns)

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
            force = (-weight * thrust(opening_of_neck(time, n), pressure)) * wp.normalize(out)
        return force

    return jet


@cache
def hole_jet_loop(at: Any) -> Any:
    """Return the function for a particle's share of the thrust of holes where its balloon is torn.

    Args:
        at: the function that reads a point.
    """
    area_vector_of_holes = hole_loop(at)

    @wp.func
    def jet_of_holes(t: Tables, points: Any, own: Any, load: wp.vec2, point: wp.vec3):
        """Force [N]; `load` is the pressure at height 0 [Pa], and its rise with height [Pa/m]."""
        hole = area_vector_of_holes(t, points, own.world, own.number, point)
        return -thrust(SHARP_EDGE, load[0] + load[1] * wp.dot(point, t.up)) * hole

    return jet_of_holes

"""Adjoint of springs and area vectors together, where quads go all around a particle: each point is read once for both.

See `springs` and `areas` for what it is, and `loops.rings` for the order.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.adjoints.springs import KINDS, hooke_back
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.hooke import HOOKE
from balloon_warp.kernels.loops.areas import CROSSES, plus_cross
from balloon_warp.kernels.loops.rings import ring_ends
from balloon_warp.kernels.memory import four_ints_at, pair_at, vector_at
from balloon_warp.kernels.phase import Look
from balloon_warp.kernels.tables import SLICE, Tables


def goes_around(features: Features, look: Look) -> bool:
    """Return whether a particle's springs and faces run backwards in one loop: where these are in arrays."""
    plain = features.of_kind("spring") == (HOOKE,) and not features.membranes
    return bool(features.rings) and plain and features.measures_areas and look.at is vector_at


@cache
def ring_adjoint(features: Features) -> Adjoint:
    """Return the adjoint that gathers the bar of a particle's place, from bars of forces and of area vectors."""
    ends_at = ring_ends(vector_at)

    @wp.func
    def of_spring(
        point_bar: wp.vec3, d: wp.vec3, bar: wp.vec3, stiffness: float, scale: float, rest_length: float
    ):  # fmt: skip
        """Return the bar of the place with what a spring adds, and what the spring gives the constant of its kind."""
        scaled = stiffness * scale
        moved, half = hooke_back(point_bar, d, bar, scaled, scaled * rest_length, rest_length)
        return moved, half * scale

    @wp.func
    def scales_of(t: Tables, entry: wp.int32):
        if wp.static(features.springs_vary):
            return pair_at(t.rings.scales, entry)
        else:
            return wp.vec2(1.0, 1.0)

    @wp.func
    def around_adjoint(
        t: Tables, points: Any, params: Any, point: wp.vec3, force_bar: wp.vec3, force_bars: Any,
        area_vector_bar: wp.vec3, area_vector_bars: Any,
    ):  # fmt: skip
        point_bar = wp.vec3()
        crosses = wp.vec3()
        structural = float(0.0)
        shear = float(0.0)
        flexion = float(0.0)
        place = four_ints_at(t.rings.places, params.number)
        before = vector_at(points, place[3]) - point
        before_bar = vector_at(area_vector_bars, place[3]) - area_vector_bar
        middle = place[0] + SLICE * place[1]
        next_ends = ends_at(t.rings, place[0])
        next_lengths = pair_at(t.rings.lengths, place[0])
        for entry in range(place[0], middle, SLICE):
            ends = next_ends
            lengths = next_lengths
            next_ends = ends_at(t.rings, entry + SLICE)  # so that they are there in the next turn
            next_lengths = pair_at(t.rings.lengths, entry + SLICE)
            scales = scales_of(t, entry)
            across = vector_at(points, ends[0]) - point
            along = vector_at(points, ends[1]) - point
            pull = force_bar - vector_at(force_bars, ends[0])
            point_bar, half = of_spring(point_bar, across, pull, params.n[1], scales[0], lengths[0])
            shear += half
            pull_along = force_bar - vector_at(force_bars, ends[1])
            point_bar, half_along = of_spring(point_bar, along, pull_along, params.n[0], scales[1], lengths[1])
            structural += half_along
            across_bar = vector_at(area_vector_bars, ends[0]) - area_vector_bar
            along_bar = vector_at(area_vector_bars, ends[1]) - area_vector_bar
            crosses = plus_cross(crosses, along_bar - before_bar, before + across)
            crosses = plus_cross(crosses, along - before, before_bar + across_bar)
            before = along
            before_bar = along_bar
        for entry in range(middle, middle + SLICE * place[2], SLICE):
            ends = next_ends
            lengths = next_lengths
            next_ends = ends_at(t.rings, entry + SLICE)
            next_lengths = pair_at(t.rings.lengths, entry + SLICE)
            scales = scales_of(t, entry)
            for number in range(2):  # padding leads to the particle itself: no force, and no bar
                d = vector_at(points, ends[number]) - point
                pull = force_bar - vector_at(force_bars, ends[number])
                point_bar, half = of_spring(point_bar, d, pull, params.n[2], scales[number], lengths[number])
                flexion += half
        return point_bar + CROSSES * crosses, structural, shear, flexion

    return Adjoint(around_adjoint, ("point", *KINDS))

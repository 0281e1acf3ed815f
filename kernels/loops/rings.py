"""A particle's springs and faces together, where quads go all around it: each point is read once for both."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.inflation import FAR
from balloon_warp.kernels.loops.areas import CROSSES, plus_cross_at_quad_corner
from balloon_warp.kernels.loops.inflation_directions import normal_of_quads, see_quad
from balloon_warp.kernels.loops.springs import spring_pull
from balloon_warp.kernels.memory import four_ints_at, in_tile, int_pair_at, packed_pair_at, pair_at
from balloon_warp.kernels.tables import SLICE, RingTable, Tables


@cache
def ring_ends(at: Any) -> Any:
    """Return the function that reads the ends of two springs in the schedule's layout."""
    packed = at is in_tile

    @wp.func
    def ends_at(rings: RingTable, entry: wp.int32):
        if wp.static(packed):
            return packed_pair_at(rings.packed_ends, entry)
        else:
            return int_pair_at(rings.ends, entry)

    return ends_at


@cache
def ring_loop(features: Features, at: Any, inflation_directions: bool = False) -> Any:
    """Return the function that loops over the quads around a particle, and then over its flexion springs.

    Args:
        inflation_directions: whether it finds A_p n, too.
    """
    pull_of_spring = spring_pull(features)
    ends_at = ring_ends(at)

    @wp.func
    def scales_of(t: Tables, entry: wp.int32):
        """Return the factors on the constants of two springs."""
        if wp.static(features.springs_vary):
            return pair_at(t.rings.scales, entry)
        else:
            return wp.vec2(1.0, 1.0)

    @wp.func
    def around(
        t: Tables,
        points: Any,
        velocities: Any,
        params: Any,
        springs: Any,
        point: wp.vec3,
        velocity: wp.vec3,
        time: float,
    ):
        """Return the net force of the springs [N], and where they are needed the area vector and A_p n [m^2]."""
        force = wp.vec3()
        crosses = wp.vec3()
        normal = wp.vec3()
        nearest = wp.vec2(FAR, 0.0)
        place = four_ints_at(t.rings.places, params.number)
        before = at(points, place[3]) - point
        middle = place[0] + SLICE * place[1]
        next_ends = ends_at(t.rings, place[0])
        next_lengths = pair_at(t.rings.lengths, place[0])
        for entry in range(place[0], middle, SLICE):
            ends = next_ends
            lengths = next_lengths
            next_ends = ends_at(t.rings, entry + SLICE)  # so that they are there in the next turn
            next_lengths = pair_at(t.rings.lengths, entry + SLICE)
            scales = scales_of(t, entry)
            across = at(points, ends[0]) - point
            along = at(points, ends[1]) - point
            force += pull_of_spring(
                t, velocities, params, ends[0], across, params.n[1] * scales[0], lengths[0], velocity, time
            )
            force += pull_of_spring(
                t, velocities, params, ends[1], along, params.n[0] * scales[1], lengths[1], velocity, time
            )
            if wp.static(features.measures_areas):
                crosses = plus_cross_at_quad_corner(crosses, before, across, along)
            if wp.static(inflation_directions):
                turned, nearer = see_quad(normal, nearest, before, across, along)
                normal = turned
                nearest = nearer
            before = along
        for entry in range(middle, middle + SLICE * place[2], SLICE):
            ends = next_ends
            lengths = next_lengths
            next_ends = ends_at(t.rings, entry + SLICE)
            next_lengths = pair_at(t.rings.lengths, entry + SLICE)
            scales = scales_of(t, entry)
            for number in range(2):
                force += pull_of_spring(
                    t, velocities, params, ends[number], at(points, ends[number]) - point, params.n[2] * scales[number],
                    lengths[number], velocity, time,
                )  # fmt: skip
        return force, CROSSES * crosses, normal_of_quads(normal, nearest)

    return around

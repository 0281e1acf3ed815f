"""A particle's springs and faces together, where quads go all around it: each point is read once for both."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.inflation import FAR
from balloon_warp.kernels.loops.aims import facing_of_quads, see_quad
from balloon_warp.kernels.loops.areas import CROSSES, cross_at_quad_corner
from balloon_warp.kernels.loops.springs import spring_pull
from balloon_warp.kernels.memory import four_at, four_ints_at, pair_at
from balloon_warp.kernels.tables import SLICE, Tables
from balloon_warp.kernels.traits import Traits


@cache
def ring_loop(traits: Traits, at: Any, aims: bool = False) -> Any:
    """The function that goes around a particle, and then through its flexion springs.

    Args:
        aims: whether it finds A_p n, too.
    """
    pull_of_spring = spring_pull(traits)

    @wp.func
    def scales_of(t: Tables, entry: wp.int32):
        """Of two springs."""
        if wp.static(traits.springs_vary):
            return pair_at(t.rings.scales, entry)
        else:
            return wp.vec2(1.0, 1.0)

    @wp.func
    def around(
        t: Tables,
        points: Any,
        velocities: Any,
        own: Any,
        springs: Any,
        point: wp.vec3,
        velocity: wp.vec3,
        time: float,
    ):
        """Net force of the springs [N], and where they are needed the area vector and A_p n [m^2]."""
        force = wp.vec3()
        crosses = wp.vec3()
        normal = wp.vec3()
        nearest = wp.vec2(FAR, 0.0)
        place = four_ints_at(t.rings.places, own.number)
        before = at(points, place[3]) - point
        middle = place[0] + SLICE * place[1]
        ahead = four_at(t.rings.entries, place[0])
        for entry in range(place[0], middle, SLICE):
            quad = ahead
            ahead = four_at(t.rings.entries, entry + SLICE)  # so that it is there in the next turn
            scales = scales_of(t, entry)
            opposite = wp.cast(quad[0], wp.int32)
            neighbor = wp.cast(quad[1], wp.int32)
            across = at(points, opposite) - point
            along = at(points, neighbor) - point
            force += pull_of_spring(t, velocities, own, opposite, across, own.n[1] * scales[0], quad[2], velocity, time)
            force += pull_of_spring(t, velocities, own, neighbor, along, own.n[0] * scales[1], quad[3], velocity, time)
            if wp.static(traits.measures_areas):
                crosses += cross_at_quad_corner(before, across, along)
            if wp.static(aims):
                turned, nearer = see_quad(normal, nearest, before, across, along)
                normal = turned
                nearest = nearer
            before = along
        for entry in range(middle, middle + SLICE * place[2], SLICE):
            two = ahead
            ahead = four_at(t.rings.entries, entry + SLICE)
            scales = scales_of(t, entry)
            for number in range(2):
                end = wp.cast(two[number], wp.int32)
                force += pull_of_spring(
                    t, velocities, own, end, at(points, end) - point, own.n[2] * scales[number], two[2 + number],
                    velocity, time,
                )  # fmt: skip
        return force, CROSSES * crosses, facing_of_quads(normal, nearest)

    return around

"""Membranes in lanes: the triangles around eight particles at a time."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import LANE_COUNT, Lanes, Lanes3, dot_product, of_lane, scaled
from balloon_warp.kernels.loops.membranes import material_reader, tension_function
from balloon_warp.kernels.schedules.layouts import near
from balloon_warp.kernels.traits import Traits


@cache
def lane_membrane_loop(traits: Traits) -> Any:
    """The function that sums the triangles of an item."""
    tension = tension_function(traits)
    material_of = material_reader(traits)

    @wp.func
    def pull_of_membrane(t: Any, points: Any, velocities: Any, own: Any, point: Lanes3, velocity: Lanes3):
        """Net force of the membrane [N]."""
        force = Lanes3()
        material = material_of(t.all.membranes, own.balloon)
        for entry in range(t.membrane_offsets[own.item], t.membrane_offsets[own.item + 1]):
            first = t.membrane_firsts[entry]
            second = t.membrane_seconds[entry]
            d1 = near(points, first) - point
            d2 = near(points, second) - point
            d11 = dot_product(d1, d1)
            d12 = dot_product(d1, d2)
            d22 = dot_product(d2, d2)
            r11, r12, r22 = Lanes(), Lanes(), Lanes()
            if wp.static(traits.viscous):
                v1 = near(velocities, first) - velocity
                v2 = near(velocities, second) - velocity
                r11 = 2.0 * dot_product(d1, v1)
                r12 = dot_product(d1, v2) + dot_product(v1, d2)
                r22 = 2.0 * dot_product(d2, v2)
            along_first, along_second = Lanes(), Lanes()
            rests = t.membrane_rests[entry]
            for lane in range(LANE_COUNT):
                pulls = tension(
                    wp.vec3(d11[lane], d12[lane], d22[lane]), wp.vec3(r11[lane], r12[lane], r22[lane]),
                    of_lane(rests, lane), material, own.n, lane,
                )  # fmt: skip
                along_first[lane] = pulls[0] + pulls[1]
                along_second[lane] = pulls[1] + pulls[2]
            force += scaled(d1, along_first) + scaled(d2, along_second)
        return force

    return pull_of_membrane

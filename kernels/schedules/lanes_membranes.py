"""Membranes in lanes: triangle by triangle, in eight worlds or eight at a time, the forces on corners add up in memory,
which one thread alone has, and wait there for the particles."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import LANE_COUNT, LaneNumbers, Lanes, Lanes3, dot_product, of_lane, scaled
from balloon_warp.kernels.loops.membranes import material_reader, tension_function
from balloon_warp.kernels.schedules.lanes_tables import lane_structs
from balloon_warp.kernels.schedules.layouts import Layout, near
from balloon_warp.kernels.traits import Traits


@wp.func
def add_at(vectors: wp.array[Lanes3], item: wp.int32, more: Lanes3):
    """To that of an item."""
    vectors[item] = vectors[item] + more


@wp.func_native(
    """
    for (int lane = 0; lane < 8; ++lane) {
        auto& vector = vectors.data[numbers[lane]];
        for (int axis = 0; axis < 3; ++axis)
            vector[axis] += more.data[axis][lane];
    }
    """
)
def add_at(vectors: wp.array[wp.vec4], numbers: LaneNumbers, more: Lanes3):  # noqa: F811 - an overload
    """To those of eight particles, of which some may be the same."""
    ...


@cache
def stretch_function(traits: Traits, layout: Layout) -> Any:
    """The function that adds up the forces of all membranes of a group of worlds, or of a world."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    tension = tension_function(traits)
    material_of = material_reader(traits)
    viscous, Vector = traits.viscous, layout.vector  # noqa: N806 - a type

    @wp.func
    def stretch_one(
        t: LaneTables, entry: wp.int32, material: wp.int32, n: Any, points: Any, velocities: Any, forces: Any
    ):
        """A triangle."""
        first = t.triangle_firsts[entry]
        second = t.triangle_seconds[entry]
        third = t.triangle_thirds[entry]
        point = near(points, first)
        d1 = near(points, second) - point
        d2 = near(points, third) - point
        d11 = dot_product(d1, d1)
        d12 = dot_product(d1, d2)
        d22 = dot_product(d2, d2)
        r11, r12, r22 = Lanes(), Lanes(), Lanes()
        if wp.static(viscous):
            velocity = near(velocities, first)
            v1 = near(velocities, second) - velocity
            v2 = near(velocities, third) - velocity
            r11 = 2.0 * dot_product(d1, v1)
            r12 = dot_product(d1, v2) + dot_product(v1, d2)
            r22 = 2.0 * dot_product(d2, v2)
        t11, t12, t22 = Lanes(), Lanes(), Lanes()
        rests = t.triangle_rests[entry]
        for lane in range(LANE_COUNT):
            pulls = tension(
                wp.vec3(d11[lane], d12[lane], d22[lane]), wp.vec3(r11[lane], r12[lane], r22[lane]),
                of_lane(rests, lane), material, n, lane,
            )  # fmt: skip
            t11[lane] = pulls[0]
            t12[lane] = pulls[1]
            t22[lane] = pulls[2]
        on_second = scaled(d1, -t11) + scaled(d2, -t12)
        on_third = scaled(d1, -t12) + scaled(d2, -t22)
        add_at(forces, first, -(on_second + on_third))
        add_at(forces, second, on_second)
        add_at(forces, third, on_third)

    @wp.func
    def stretch(t: LaneTables, lanes: LaneState, group: wp.int32, points: Any):
        forces = t.membrane_forces[group]
        for item in range(forces.shape[0]):
            forces[item] = Vector()
        for balloon in range(t.all.inflation_kind.shape[0]):
            material = material_of(t.all.membranes, balloon)
            n = lanes.numbers[group, balloon]
            for entry in range(t.triangle_offsets[balloon], t.triangle_offsets[balloon + 1]):
                stretch_one(t, entry, material, n, points, lanes.shown_velocities[group], forces)

    return stretch

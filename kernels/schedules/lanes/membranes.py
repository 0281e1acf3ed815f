"""Membranes in lanes: quad by quad and triangle by triangle, in eight worlds or eight at a time, the forces on corners
add up in memory, which one thread alone has, and wait there for the particles."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import (
    LANE_COUNT,
    LaneNumbers,
    Lanes,
    Lanes3,
    Lanes4,
    any_negative,
    dot_product,
    of_lane,
)
from balloon_warp.kernels.laws.tension_field import NEVER_ZERO, how_surely_taut
from balloon_warp.kernels.loops.membranes import (
    material_reader,
    pulls_on_corners,
    taut_tension_function,
    tension_function,
)
from balloon_warp.kernels.schedules.lanes.layouts import Layout, entry_at, near
from balloon_warp.kernels.schedules.lanes.tables import lane_structs
from balloon_warp.kernels.schedules.lanes.wear import wear_quad_function
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
def pull_function(traits: Traits, layout: Layout, surely_taut: bool) -> Any:
    """The function that gives the tensions of the triangles of a quad, or of eight.

    Args:
        surely_taut: whether all are known to be taut, see `how_surely_taut`, so that it takes less.
    """
    LaneTables, _, _ = lane_structs(layout)  # noqa: N806 - a type
    tension, taut_tension = tension_function(traits), taut_tension_function(traits)

    @wp.func
    def pull(
        t: LaneTables, entry: wp.int32, material: wp.int32, n: Any, d11: Lanes4, d12: Lanes4, r11: Lanes4, r12: Lanes4
    ):  # fmt: skip
        """From the products of the quad's edges, and how they change, as `pulls_on_corners` takes them."""
        along, mixed, back = Lanes4(), Lanes4(), Lanes4()
        for corner in range(t.quad_triangles[entry]):
            e11 = d11[corner]
            e12 = d12[corner]
            e22 = d11[(corner + 3) % 4]
            f11 = r11[corner]
            f12 = r12[corner]
            f22 = r11[(corner + 3) % 4]
            rests = t.quad_rests[4 * entry + corner]
            t11, t12, t22 = Lanes(), Lanes(), Lanes()
            for lane in range(LANE_COUNT):
                metric = wp.vec3(e11[lane], e12[lane], e22[lane])
                if wp.static(surely_taut):
                    pulls = taut_tension(metric, of_lane(rests, lane), material, n, lane)
                else:
                    rate = wp.vec3(f11[lane], f12[lane], f22[lane])
                    pulls = tension(metric, rate, of_lane(rests, lane), material, n, lane)
                t11[lane] = pulls[0]
                t12[lane] = pulls[1]
                t22[lane] = pulls[2]
            along[corner] = t11
            mixed[corner] = t12
            back[(corner + 3) % 4] = t22
        return along, mixed, back

    return pull


@cache
def stretch_function(traits: Traits, layout: Layout) -> Any:
    """The function that adds up the forces of all membranes of a group of worlds, or of a world."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    material_of = material_reader(traits)
    viscous, Vector = traits.viscous, layout.vector  # noqa: N806 - a type

    @wp.func
    def are_surely_taut(t: LaneTables, entry: wp.int32, d11: Lanes4, d12: Lanes4):
        """Whether all triangles of a quad are, in all lanes, so that they need no more than `pull_taut`."""
        surely = bool(True)
        for corner in range(t.quad_triangles[entry]):
            e11 = d11[corner]
            e12 = d12[corner]
            e22 = d11[(corner + 3) % 4]
            rests = t.quad_rests[4 * entry + corner]
            excess = Lanes()
            for lane in range(LANE_COUNT):
                surplus = how_surely_taut(wp.vec3(e11[lane], e12[lane], e22[lane]), of_lane(rests, lane))
                excess[lane] = surplus - NEVER_ZERO
            surely = surely and not any_negative(excess)
        return surely

    wear_quad = wear_quad_function(traits, layout) if traits.softens else None
    pull, pull_taut = (pull_function(traits, layout, surely_taut) for surely_taut in (False, True))

    @wp.func
    def stretch_quad(
        t: LaneTables,
        lanes: LaneState,
        group: wp.int32,
        balloon: wp.int32,
        entry: wp.int32,
        material: wp.int32,
        n: Any,
        points: Any,
        velocities: Any,
        forces: Any,
    ):
        """One, or eight: the triangles at its corners share its edges, and what passes along these."""
        first = entry_at(t.quads, 4 * entry)
        second = entry_at(t.quads, 4 * entry + 1)
        third = entry_at(t.quads, 4 * entry + 2)
        fourth = entry_at(t.quads, 4 * entry + 3)
        a = near(points, first)
        b = near(points, second)
        c = near(points, third)
        d = near(points, fourth)
        ab = b - a
        bc = c - b
        cd = d - c
        da = a - d
        d11 = Lanes4()  # a row a corner; a local array would have its address and strides written for every quad
        d12 = Lanes4()
        d11[0] = dot_product(ab, ab)
        d11[1] = dot_product(bc, bc)
        d11[2] = dot_product(cd, cd)
        d11[3] = dot_product(da, da)
        d12[0] = -dot_product(ab, da)
        d12[1] = -dot_product(bc, ab)
        d12[2] = -dot_product(cd, bc)
        d12[3] = -dot_product(da, cd)
        r11 = Lanes4()
        r12 = Lanes4()
        if wp.static(viscous):
            va = near(velocities, first)
            vb = near(velocities, second)
            vc = near(velocities, third)
            vd = near(velocities, fourth)
            r11[0] = 2.0 * dot_product(ab, vb - va)
            r11[1] = 2.0 * dot_product(bc, vc - vb)
            r11[2] = 2.0 * dot_product(cd, vd - vc)
            r11[3] = 2.0 * dot_product(da, va - vd)
            r12[0] = -(dot_product(ab, va - vd) + dot_product(da, vb - va))
            r12[1] = -(dot_product(bc, vb - va) + dot_product(ab, vc - vb))
            r12[2] = -(dot_product(cd, vc - vb) + dot_product(bc, vd - vc))
            r12[3] = -(dot_product(da, vd - vc) + dot_product(cd, va - vd))
        along, mixed, back = Lanes4(), Lanes4(), Lanes4()
        if wp.static(viscous):
            along, mixed, back = pull(t, entry, material, n, d11, d12, r11, r12)
        else:
            if are_surely_taut(t, entry, d11, d12):
                along, mixed, back = pull_taut(t, entry, material, n, d11, d12, r11, r12)
            else:
                along, mixed, back = pull(t, entry, material, n, d11, d12, r11, r12)
        if wp.static(wear_quad is not None):
            along, mixed, back = wear_quad(t, lanes, group, balloon, entry, d11, d12, along, mixed, back)
        on_a, on_b, on_c, on_d = pulls_on_corners(ab, bc, cd, da, along, mixed, back)
        add_at(forces, first, on_a)
        add_at(forces, second, on_b)
        add_at(forces, third, on_c)
        add_at(forces, fourth, on_d)

    @wp.func
    def stretch(t: LaneTables, lanes: LaneState, group: wp.int32, points: Any):
        forces = t.membrane_forces[group]
        velocities = lanes.shown_velocities[group]
        for item in range(forces.shape[0]):
            forces[item] = Vector()
        for balloon in range(t.all.inflation_kind.shape[0]):
            material = material_of(t.all.membranes, balloon)
            n = lanes.numbers[group, balloon]
            for entry in range(t.quad_offsets[balloon], t.quad_offsets[balloon + 1]):
                stretch_quad(t, lanes, group, balloon, entry, material, n, points, velocities, forces)

    return stretch

"""The quads of membranes, eight side by side: the triangles at the corners of each share its edges."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import dot_product, times
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes4, any_negative, entry_at, of_lane
from balloon_warp.kernels.laws.tension_field import NEVER_ZERO, how_surely_taut
from balloon_warp.kernels.loops.membranes import (
    pulls_on_corners,
    taut_tension_function,
    tension_function,
)
from balloon_warp.kernels.loops.wear import wear_of_triangle


@wp.func
def products_of(ab: Any, bc: Any, cd: Any, da: Any):
    """Return the dot products of edges at each corner, a row a corner.

    Products of the first edge with itself and with the one before. A local array would have its address and strides
    written for every quad.
    """
    squares = Lanes4()
    mixed = Lanes4()
    squares[0] = dot_product(ab, ab)
    squares[1] = dot_product(bc, bc)
    squares[2] = dot_product(cd, cd)
    squares[3] = dot_product(da, da)
    mixed[0] = -dot_product(ab, da)
    mixed[1] = -dot_product(bc, ab)
    mixed[2] = -dot_product(cd, bc)
    mixed[3] = -dot_product(da, cd)
    return squares, mixed


@wp.func
def rates_of(ab: Any, bc: Any, cd: Any, da: Any, a: Any, b: Any, c: Any, d: Any):
    """Return the rates of change of `products_of`, where a to d are the velocities of the corners."""
    squares = Lanes4()
    mixed = Lanes4()
    squares[0] = 2.0 * dot_product(ab, b - a)
    squares[1] = 2.0 * dot_product(bc, c - b)
    squares[2] = 2.0 * dot_product(cd, d - c)
    squares[3] = 2.0 * dot_product(da, a - d)
    mixed[0] = -(dot_product(ab, a - d) + dot_product(da, b - a))
    mixed[1] = -(dot_product(bc, b - a) + dot_product(ab, c - b))
    mixed[2] = -(dot_product(cd, c - b) + dot_product(bc, d - c))
    mixed[3] = -(dot_product(da, d - c) + dot_product(cd, a - d))
    return squares, mixed


@cache
def tensions_function(features: Features, surely_taut: bool) -> Any:
    """Return the function for the tensions of the triangles of a quad, as `pulls_on_corners` takes them.

    Args:
        surely_taut: whether all are known to be taut, see `how_surely_taut`, so that it takes less.
    """
    tension, taut_tension = tension_function(features), taut_tension_function(features)

    @wp.func
    def tensions(t: Any, params: Any, d11: Lanes4, d12: Lanes4, r11: Lanes4, r12: Lanes4):
        """Return the tensions of a quad from the dot products of its edges and their rates."""
        material = t.all.membranes.materials[params.balloon]
        along, mixed, back = Lanes4(), Lanes4(), Lanes4()
        for corner in range(t.quad_triangles[params.number]):
            e11 = d11[corner]
            e12 = d12[corner]
            e22 = d11[(corner + 3) % 4]
            f11 = r11[corner]
            f12 = r12[corner]
            f22 = r11[(corner + 3) % 4]
            rests = t.quad_rests[4 * params.number + corner]
            t11, t12, t22 = Lanes(), Lanes(), Lanes()
            for lane in range(LANE_COUNT):
                metric = wp.vec3(e11[lane], e12[lane], e22[lane])
                if wp.static(surely_taut):
                    pulls = taut_tension(metric, of_lane(rests, lane), material, params.n, lane)
                else:
                    rate = wp.vec3(f11[lane], f12[lane], f22[lane])
                    pulls = tension(metric, rate, of_lane(rests, lane), material, params.n, lane)
                t11[lane] = pulls[0]
                t12[lane] = pulls[1]
                t22[lane] = pulls[2]
            along[corner] = t11
            mixed[corner] = t12
            back[(corner + 3) % 4] = t22
        return along, mixed, back

    return tensions


@wp.func
def are_surely_taut(t: Any, params: Any, d11: Lanes4, d12: Lanes4):
    """Return whether all triangles of a quad are surely taut, in all lanes."""
    surely = bool(True)
    for corner in range(t.quad_triangles[params.number]):
        e11 = d11[corner]
        e12 = d12[corner]
        e22 = d11[(corner + 3) % 4]
        rests = t.quad_rests[4 * params.number + corner]
        excess = Lanes()
        for lane in range(LANE_COUNT):
            surplus = how_surely_taut(wp.vec3(e11[lane], e12[lane], e22[lane]), of_lane(rests, lane))
            excess[lane] = surplus - NEVER_ZERO
        surely = surely and not any_negative(excess)
    return surely


@cache
def quad_wear(features: Features, at: Any, world_of: Any) -> Any:
    """Return the function for the wear of quads.

    Args:
        at: the function that reads eight points.
        world_of: the one that gives the world in a lane.
    """
    wear = wear_of_triangle(features)

    @wp.func
    def wear_of_quad(t: Any, points: Any, params: Any, peaks: wp.array2d[float]):
        """Find the factors of wear on the tensions of a quad's triangles, and keep their peak stretches."""
        corners = 4 * params.number
        a = at(points, entry_at(t.quads, corners))
        b = at(points, entry_at(t.quads, corners + 1))
        c = at(points, entry_at(t.quads, corners + 2))
        d = at(points, entry_at(t.quads, corners + 3))
        d11, d12 = products_of(b - a, c - b, d - c, a - d)
        material = t.all.membranes.materials[params.balloon]
        for corner in range(t.quad_triangles[params.number]):
            e11 = d11[corner]
            e12 = d12[corner]
            e22 = d11[(corner + 3) % 4]
            rests = t.quad_rests[corners + corner]
            numbers = t.quad_numbers[corners + corner]
            kept, left = Lanes(), Lanes()
            for lane in range(LANE_COUNT):
                kept[lane] = peaks[world_of(t, params, lane), wp.max(of_lane(numbers, lane), 0)]
            for lane in range(LANE_COUNT):
                metric = wp.vec3(e11[lane], e12[lane], e22[lane])
                of_one, greatest, _stress = wear(
                    t.all, world_of(t, params, lane), params.balloon, material, metric, of_lane(rests, lane),
                    kept[lane], params.n, lane,
                )  # fmt: skip
                left[lane] = of_one
                kept[lane] = greatest
            for back in range(LANE_COUNT):
                lane = LANE_COUNT - 1 - back  # lanes beyond the last world are copies of it: its own comes last
                triangle = of_lane(numbers, lane)
                if triangle >= 0:
                    peaks[world_of(t, params, lane), triangle] = kept[lane]
                    t.all.membranes.wear.left[world_of(t, params, lane), triangle] = left[lane]

    return wear_of_quad


@cache
def quad_pull(features: Features, at: Any, world_of: Any) -> Any:
    """Return the function for the forces of quads on their corners.

    Args:
        at: the function that reads eight points.
        world_of: the one that gives the world in a lane.
    """
    tensions, taut_tensions = (tensions_function(features, surely_taut) for surely_taut in (False, True))

    @wp.func
    def worn(t: Any, params: Any, along: Lanes4, mixed: Lanes4, back: Lanes4):
        """Return the tensions of a quad reduced by the wear of its triangles, see `phases.wear`."""
        for corner in range(t.quad_triangles[params.number]):
            numbers = t.quad_numbers[4 * params.number + corner]
            left = Lanes()
            for lane in range(LANE_COUNT):
                triangle = wp.max(of_lane(numbers, lane), 0)
                left[lane] = t.all.membranes.wear.left[world_of(t, params, lane), triangle]
            along[corner] = times(along[corner], left)
            mixed[corner] = times(mixed[corner], left)
            back[(corner + 3) % 4] = times(back[(corner + 3) % 4], left)
        return along, mixed, back

    @wp.func
    def pull_of_quad(t: Any, points: Any, velocities: Any, params: Any):
        """Return the forces on the four corners of each [N]."""
        corners = 4 * params.number
        first = entry_at(t.quads, corners)
        second = entry_at(t.quads, corners + 1)
        third = entry_at(t.quads, corners + 2)
        fourth = entry_at(t.quads, corners + 3)
        a = at(points, first)
        b = at(points, second)
        c = at(points, third)
        d = at(points, fourth)
        ab = b - a
        bc = c - b
        cd = d - c
        da = a - d
        d11, d12 = products_of(ab, bc, cd, da)
        r11, r12 = Lanes4(), Lanes4()
        along, mixed, back = Lanes4(), Lanes4(), Lanes4()
        if wp.static(features.viscous):
            r11, r12 = rates_of(
                ab, bc, cd, da, at(velocities, first), at(velocities, second), at(velocities, third),
                at(velocities, fourth),
            )  # fmt: skip
            along, mixed, back = tensions(t, params, d11, d12, r11, r12)
        else:
            if are_surely_taut(t, params, d11, d12):
                along, mixed, back = taut_tensions(t, params, d11, d12, r11, r12)
            else:
                along, mixed, back = tensions(t, params, d11, d12, r11, r12)
        if wp.static(features.wears):
            along, mixed, back = worn(t, params, along, mixed, back)
        return pulls_on_corners(ab, bc, cd, da, along, mixed, back)

    return pull_of_quad

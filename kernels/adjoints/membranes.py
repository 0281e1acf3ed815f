"""Adjoints of membranes: triangles of rubber or film, and quads eight side by side.

A triangle pulls its corners with forces whose sum is zero. Its part in the sum over all particles of force . bar is
that of two of them times how their bars differ from the first corner's, and Warp derives that by edges, by how fast
they change, and by the material's numbers. All three corners come to it: each takes its own bar, and a third of the
numbers'.

Changes of the tensions of eight triangles of membranes, by their edges' products, and of their energy, by numbers. It
is `loops.membranes.tension_function`, differentiated: see there, and `laws.membrane` for taut, wrinkled and slack
triangles. The slopes of a law by trace and determinant are those of an energy, so that their changes are symmetric:
Warp's derivatives of the slopes times the changes of trace and determinant are the changes of the slopes.

Quads go eight side by side, see `loops.quads`. The forces on the corners combine the quad's edges by tensions, which
depend on the edges' products alone. With an energy, derivatives of forces are symmetric: the bars of the corners'
places are how their forces change as the corners move by their bars. So they combine, in the same way, edges between
the bars by the tensions, and the quad's edges by how the tensions change.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.compose import choice_of_laws_of_few, function_from, params_functions
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes3, Lanes4, Lanes5, entry_at, number_in
from balloon_warp.kernels.laws.membrane import LEAST_DET, NEVER_ZERO, mixed_stretch
from balloon_warp.kernels.loops.membranes import (
    MembraneFaceLayout,
    is_there,
    membrane_face_places,
    membrane_faces_of,
    pulls_on_corners,
    rest_of,
    triangle_pull,
)
from balloon_warp.kernels.loops.quads import products_of, rates_of
from balloon_warp.kernels.memory import four_floats_at, four_ints_at, int_pair_at, vector_at
from balloon_warp.kernels.phase import Access, Adjoint, NoAdjointError, Phase
from balloon_warp.kernels.tables import SLICE, Tables, first_entry

AT_REST = wp.constant(1.0e-4)
"""Largest change of G M from 1 that counts as rest: float32 does not tell which side of the law's kink it is on"""


@wp.func
def is_unstretched(mixed: wp.vec4):
    """Test for a triangle of this G M at rest, whose tension and bars are 0.

    There the law has a kink, and each corner, which measures the triangle by edges of its own, might see another side.
    """
    return (
        wp.max(wp.max(wp.abs(mixed[0] - 1.0), wp.abs(mixed[3] - 1.0)), wp.max(wp.abs(mixed[1]), wp.abs(mixed[2])))
        < AT_REST
    )


@wp.func
def is_at_rest(d1: wp.vec3, d2: wp.vec3, rest: wp.vec4):
    """Return `is_unstretched` of a triangle with two edges."""
    return is_unstretched(mixed_stretch(wp.vec3(wp.dot(d1, d1), wp.dot(d1, d2), wp.dot(d2, d2)), rest))


@cache
def triangle_pairing_function(features: Features) -> Any:
    """Pairing of a triangle's forces with their bars."""
    pull_of_triangle = triangle_pull(features)

    @wp.func
    def triangle_pairing(
        d1: wp.vec3, d2: wp.vec3, v1: wp.vec3, v2: wp.vec3, n: Any, rest: wp.vec4, material: wp.int32, b1: wp.vec3,
        b2: wp.vec3,
    ):  # fmt: skip
        """Pairing of the forces at both edges' ends with their bars relative to the first corner's."""
        _pull, first, second = pull_of_triangle(d1, d2, v1, v2, rest, material, n)
        return wp.dot(first, b1) + wp.dot(second, b2)

    return triangle_pairing


@cache
def membrane_adjoint(features: Features, at: Any) -> Adjoint:
    """Return the adjoint that gathers bars of a particle's place and velocity, and of its balloon's numbers."""
    triangle_pairing = triangle_pairing_function(features)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def triangles_adjoint(
        t: Tables, points: Any, velocities: Any, params: Any, point: wp.vec3, velocity: wp.vec3, force_bar: wp.vec3,
        force_bars: Any,
    ):  # fmt: skip
        point_bar = wp.vec3()
        velocity_bar = wp.vec3()
        params_bar = Params()
        material = t.membranes.materials[params.balloon]
        begin = first_entry(t.membranes.slice_offsets, params.number)
        for entry in range(begin, begin + SLICE * t.membranes.counts[params.number], SLICE):
            others = int_pair_at(t.membranes.others, entry)
            v1 = wp.vec3()
            v2 = wp.vec3()
            if wp.static(features.viscous):
                v1 = vector_at(velocities, others[0]) - velocity
                v2 = vector_at(velocities, others[1]) - velocity
            d1 = at(points, others[0]) - point
            d2 = at(points, others[1]) - point
            rest = four_floats_at(t.membranes.rests, entry)
            if not is_at_rest(d1, d2, rest):
                by_d1, by_d2, by_v1, by_v2, by_n, _rest, _material, _b1, _b2 = wp.grad(triangle_pairing)(
                    d1, d2, v1, v2, params.n, rest, material,
                    at(force_bars, others[0]) - force_bar, at(force_bars, others[1]) - force_bar,
                )  # fmt: skip
                point_bar -= by_d1 + by_d2
                if wp.static(features.viscous):
                    velocity_bar -= by_v1 + by_v2
                params_bar.n += (1.0 / 3.0) * by_n
        return point_bar, velocity_bar, params_bar

    return Adjoint(triangles_adjoint, ("point", "velocity", "params"))


OF_LAW = ("trace", "det", "spread", "trace_change", "det_change", "spread_change", "by_trace_asked", "by_det_asked")
OF_TENSION = ("is_taut", "counts", "full_trace", "over_apart", "apart_change")
IN_WRINKLES = ("major", "major_change", "across", "across_change")
STATE_ROWS = (*OF_LAW, *OF_TENSION, *IN_WRINKLES)
"""Numbers of eight triangles between their edges' products and their tensions: the state at which the law is asked, how
it changes, and the factors of the law's slopes; then the inputs of their tensions, and those of wrinkles"""
StateLanes = wp.types.matrix(shape=(len(STATE_ROWS), 8), dtype=wp.float32)
"""Numbers in each of eight lanes, a row each"""
TensionLanes = wp.types.matrix(shape=(7, 8), dtype=wp.float32)
"""Tensions T11, T12 and T22 [N/m], their changes, and the weight of slopes by the law's numbers [m^3], in each lane"""
_ROWS = "\n".join(f"constexpr int {name} = {row};" for row, name in enumerate(STATE_ROWS))
_VECTORS = """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    typedef int mask __attribute__((vector_size(32), aligned(4)));
    const auto row = [](const auto& lanes, int n) { return *reinterpret_cast<const eight*>(&lanes.data[n][0]); };
    const auto choose = [](mask when, eight yes, eight no) { return (eight)(((mask)yes & when) | ((mask)no & ~when)); };
    const auto larger = [](eight a, eight b) { return __builtin_elementwise_max(a, b); };
    const eight none = {0.0f}, one = none + 1.0f;
"""


@wp.func_native(
    f"""
    {_ROWS}
    {_VECTORS}
    const auto root = [](eight squared) {{
        eight result;
        for (int k = 0; k < 8; ++k)
            result[k] = sqrtf(squared[k]);
        return result;
    }};
    const eight m0 = row(metric, 0), m1 = row(metric, 1), m2 = row(metric, 2);
    const eight c0 = row(change, 0), c1 = row(change, 1), c2 = row(change, 2);
    const eight g0 = row(rest, 0), g1 = row(rest, 1), g2 = row(rest, 2);
    const eight wrinkles = *reinterpret_cast<const eight*>(&wrinkling.c[0]);
    const eight a = g0 * m0 + g1 * m1, b = g0 * m1 + g1 * m2, c = g1 * m0 + g2 * m1, d = g1 * m1 + g2 * m2;
    const eight a_change = g0 * c0 + g1 * c1, b_change = g0 * c1 + g1 * c2;
    const eight c_change = g1 * c0 + g2 * c1, d_change = g1 * c1 + g2 * c2;
    const eight size = g0 * g2 - g1 * g1;
    const eight full = a + d, full_change = a_change + d_change;
    const eight area = a * d - b * c, area_change = size * (c0 * m2 + m0 * c2 - 2.0f * m1 * c1);
    const eight between = root(larger((a - d) * (a - d) + 4.0f * b * c, none));
    const eight over = one / larger(between, none + {NEVER_ZERO}f);
    const eight away_change = over * ((a - d) * (a_change - d_change) + 2.0f * (b_change * c + b * c_change));
    const eight most = 0.5f * (full + between), most_change = 0.5f * (full_change + away_change);
    const eight squared = larger(area, none + {LEAST_DET}f);
    const eight squared_change = choose(area > {LEAST_DET}f, area_change, none);
    const eight stretched = larger(most, one), stretched_change = choose(most > 1.0f, most_change, none);
    const eight stretch = root(stretched), thin = one / stretch;
    const eight stretch_change = 0.5f * thin * stretched_change, thin_change = -thin * thin * stretch_change;
    const mask taut = (squared >= stretch) | (wrinkles == 0.0f);
    const mask slack = (wrinkles != 0.0f) & (most <= 1.0f);
    const eight off_diagonal = larger(larger(b, -b), larger(c, -c));
    const eight off = larger(larger(larger(a - 1.0f, 1.0f - a), larger(d - 1.0f, 1.0f - d)), off_diagonal);
    const mask left_out = slack | (off < {AT_REST}f) | (row(rest, 3) <= 0.0f);
    wp::mat_t<{len(STATE_ROWS)}, 8, wp::float32> result;
    const auto put = [&result](int n, eight lanes) {{ *reinterpret_cast<eight*>(&result.data[n][0]) = lanes; }};
    put(trace, choose(taut, full, stretched + thin));
    put(det, choose(taut, squared, stretch));
    put(spread, choose(taut, between, stretched - thin));
    put(trace_change, choose(taut, full_change, stretched_change + thin_change));
    put(det_change, choose(taut, squared_change, stretch_change));
    put(spread_change, choose(taut, away_change, stretched_change - thin_change));
    put(by_trace_asked, choose(taut, full_change, one));
    put(by_det_asked, choose(taut, squared_change, thin));
    put(is_taut, choose(taut, one, none));
    put(counts, choose(left_out, none, one));
    put(full_trace, full);
    put(over_apart, over);
    put(apart_change, away_change);
    put(major, most);
    put(major_change, most_change);
    put(across, thin);
    put(across_change, thin_change);
    return result;
    """
)
def state_of_triangles(metric: Lanes3, change: Lanes3, rest: Lanes4, wrinkling: Lanes) -> StateLanes:
    """State at which the law is evaluated, and its change."""
    ...


@wp.func_native(
    f"""
    {_ROWS}
    {_VECTORS}
    const eight g0 = row(rest, 0), g1 = row(rest, 1), g2 = row(rest, 2), size = g0 * g2 - g1 * g1;
    const eight volume = 2.0f * row(rest, 3) * *reinterpret_cast<const eight*>(&thickness.c[0]) * row(state, counts);
    const eight by_trace = row(slopes, 0), by_det = row(slopes, 1);
    const eight by_t = row(slopes, 2), by_d = row(slopes, 3), by_s = row(slopes, 4);
    const mask taut = row(state, is_taut) > 0.0f;
    const eight over = row(state, over_apart), thin = row(state, across), most = row(state, major);
    const eight slope = (by_trace + by_det * thin) * over;
    const eight slope_change = over * (by_t * row(state, trace_change) + by_d * row(state, det_change)
        + by_s * row(state, spread_change) + by_det * row(state, across_change) - slope * row(state, apart_change));
    const eight first = volume * choose(taut, by_trace, slope * most);
    const eight second = volume * size * choose(taut, by_det, -slope);
    const eight first_change = volume * choose(
        taut, by_t + by_s * row(state, full_trace) * over, slope_change * most + slope * row(state, major_change));
    const eight second_change = volume * size * choose(taut, by_d - 2.0f * by_s * over, -slope_change);
    const eight turn[3] = {{row(metric, 2), -row(metric, 1), row(metric, 0)}};
    const eight turn_change[3] = {{row(change, 2), -row(change, 1), row(change, 0)}};
    const eight along[3] = {{g0, g1, g2}};
    wp::mat_t<7, 8, wp::float32> result;
    for (int n = 0; n < 3; ++n) {{
        *reinterpret_cast<eight*>(&result.data[n][0]) = first * along[n] + second * turn[n];
        *reinterpret_cast<eight*>(&result.data[3 + n][0]) =
            first_change * along[n] + second_change * turn[n] + second * turn_change[n];
    }}
    *reinterpret_cast<eight*>(&result.data[6][0]) = 0.5f * volume * choose(taut, one, row(state, major_change));
    return result;
    """
)
def tensions_of_triangles(
    metric: Lanes3, change: Lanes3, rest: Lanes4, state: StateLanes, slopes: Lanes5, thickness: Lanes
) -> TensionLanes:
    """Return the tensions and their changes, from the law's slopes and the derivatives of these."""
    ...


def few_places(features: Features) -> tuple[int, ...]:
    """Columns of the parameters of tensions: the thickness, and those that laws name."""
    _, few = choice_of_laws_of_few(features.membranes, features.columns)
    return features.columns.places["thickness"], *few


@cache
def slopes_function(features: Features) -> Any:
    """Return the function for a law's slopes by trace and determinant, and for their derivatives.

    It returns both, and how their sum, times the weight asked of each, changes with trace, determinant and spread; and
    how with the law's numbers, after a place for the thickness.
    """
    law, few = choice_of_laws_of_few(features.membranes, features.columns)
    numbers = [f"n{place}" for place in range(len(few))]
    told = ", ".join(["trace", "det", "spread", "material", *numbers])
    floats = ", ".join(f"{name}: float" for name in ("trace", "det", "spread", *numbers, "p", "q"))
    asked = function_from(
        "asked_slopes",
        f"def asked_slopes(material: wp.int32, {floats}):\n"
        f"    by_trace, by_det = law({told})\n"
        "    return by_trace * p + by_det * q\n",
        {"law": law},
    )
    state = {name: f"state[{STATE_ROWS.index(name)}, lane]" for name in STATE_ROWS}
    there = [state[name] for name in ("trace", "det", "spread")]
    values = [f"number_in(n, {column}, lane)" for column in few]
    all_told = ", ".join([*there, *values])
    derived = ", ".join(f"by_{name}" for name in ("trace", "det", "spread", *numbers))
    weights = ", ".join(state[f"{name}_asked"] for name in ("by_trace", "by_det"))
    lines = [
        "def slopes_of_eight(state: Any, material: wp.int32, n: Any):",
        "    slopes = Lanes5()",
        "    by_few = FewLanes()",
        "    for lane in range(LANE_COUNT):",
        f"        by_trace, by_det = law({', '.join([*there, 'material', *values])})",
        "        slopes[0, lane] = by_trace",
        "        slopes[1, lane] = by_det",
        "    for lane in range(LANE_COUNT):",
        f"        of_material, {derived}, by_p, by_q = wp.grad(asked)(material, {all_told}, {weights})",
        *(f"        slopes[{2 + row}, lane] = by_{name}" for row, name in enumerate(("trace", "det", "spread"))),
        *(f"        by_few[{1 + place}, lane] = by_n{place}" for place in range(len(few))),
        "    return slopes, by_few\n",
    ]
    names = {"law": law, "asked": asked, "number_in": number_in, "Lanes5": Lanes5, "LANE_COUNT": LANE_COUNT}
    return function_from("slopes_of_eight", "\n".join(lines), {**names, "FewLanes": few_lanes(1 + len(few))})


@cache
def few_lanes(count: int) -> Any:
    """Return the type of a few numbers in each of eight lanes."""
    return wp.types.matrix(shape=(count, 8), dtype=wp.float32)


@cache
def tension_changes(features: Features) -> Any:
    """Return the function for the tensions of eight triangles."""
    slopes_of_eight, few = slopes_function(features), len(few_places(features))
    thickness, wrinkling = (features.columns.places[name] for name in ("thickness", "wrinkling"))

    @wp.func
    def changes_of_triangles(metric: Lanes3, change: Lanes3, rest: Lanes4, material: wp.int32, n: Any):
        """Return the tensions and their changes, and the change of energy by each number.

        Args:
            metric: the products d1 . d1, d1 . d2 and d2 . d2 of the triangles' edges [m^2].
            change: of these.
            rest: see `kernels.tables.MembraneTable`.
            n: row of numbers.
        """
        state = state_of_triangles(metric, change, rest, n[wrinkling])
        slopes, by_few = slopes_of_eight(state, material, n)
        found = tensions_of_triangles(metric, change, rest, state, slopes, n[thickness])
        for place in range(1, few):
            by_few[place] = wp.cw_mul(found[6], by_few[place])
        pairing = 0.5 * (wp.cw_mul(found[0], change[0]) + wp.cw_mul(found[2], change[2])) + wp.cw_mul(
            found[1], change[1]
        )
        by_few[0] = wp.cw_div(pairing, n[thickness])
        return found, by_few

    return changes_of_triangles


@wp.struct
class QuadTensions:
    """Tensions of eight quads and how they change, as `pulls_on_corners` takes both."""

    along: Lanes4
    mixed: Lanes4
    back: Lanes4
    along_change: Lanes4
    mixed_change: Lanes4
    back_change: Lanes4


@wp.func
def in_lanes(rest: wp.vec4):
    """Return the rest metric of a triangle that is the same in all lanes."""
    rests = Lanes4()
    for row in range(4):
        rests[row] = Lanes(rest[row])
    return rests


@wp.func
def in_lanes(rests: Lanes4):  # noqa: F811 - an overload
    """Return the rest metrics of the triangle in each lane."""
    return rests


@cache
def changes_function(features: Features) -> Any:
    """Return the function for the tensions of eight quads and their changes."""
    changes_of_triangles, FewLanes = tension_changes(features), few_lanes(len(few_places(features)))  # noqa: N806

    @wp.func
    def changes_of_quads(t: Any, params: Any, d11: Lanes4, d12: Lanes4, r11: Lanes4, r12: Lanes4):
        """Return both, and the changes of energies by the numbers.

        Args:
            r11: changes of the products d11.
            r12: changes of the products d12.
        """
        material = t.all.membranes.materials[params.balloon]
        found = QuadTensions()
        by_numbers = FewLanes()
        for corner in range(t.quad_triangles[params.number]):
            before = (corner + 3) % 4
            metric = Lanes3()
            metric[0] = d11[corner]
            metric[1] = d12[corner]
            metric[2] = d11[before]
            change = Lanes3()
            change[0] = r11[corner]
            change[1] = r12[corner]
            change[2] = r11[before]
            rests = in_lanes(t.quad_rests[4 * params.number + corner])
            tensions, by_few = changes_of_triangles(metric, change, rests, material, params.n)
            by_numbers += by_few
            found.along[corner] = tensions[0]
            found.mixed[corner] = tensions[1]
            found.back[before] = tensions[2]
            found.along_change[corner] = tensions[3]
            found.mixed_change[corner] = tensions[4]
            found.back_change[before] = tensions[5]
        return found, by_numbers

    return changes_of_quads


@cache
def quad_adjoint(features: Features, at: Any, add_to_corners: Any) -> Adjoint:
    """Return the adjoint, which adds to the bars of the corners' places, and returns the numbers'.

    Args:
        at: the function that reads eight vectors.
        add_to_corners: the one that adds to the corners of eight quads.
    """
    changes = changes_function(features)

    @wp.func
    def turn_quads(t: Any, points: Any, params: Any, force_bars: Any, point_bars: Any):
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
        of_a = at(force_bars, first)
        of_b = at(force_bars, second)
        of_c = at(force_bars, third)
        of_d = at(force_bars, fourth)
        d11, d12 = products_of(ab, bc, cd, da)
        r11, r12 = rates_of(ab, bc, cd, da, of_a, of_b, of_c, of_d)
        found, by_numbers = changes(t, params, d11, d12, r11, r12)
        on_a, on_b, on_c, on_d = pulls_on_corners(
            of_b - of_a, of_c - of_b, of_d - of_c, of_a - of_d, found.along, found.mixed, found.back
        )
        by_a, by_b, by_c, by_d = pulls_on_corners(
            ab, bc, cd, da, found.along_change, found.mixed_change, found.back_change
        )
        add_to_corners(point_bars, first, second, third, fourth, on_a + by_a, on_b + by_b, on_c + by_c, on_d + by_d)
        return -by_numbers

    return Adjoint(turn_quads, ("numbers",), columns=few_places(features))


def quads_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Return the adjoint of the forces of quads.

    Raises:
        NoAdjointError: the membrane is viscous, or wears.
    """
    if features.viscous or features.wears:
        raise NoAdjointError("a membrane that is viscous, softens or bursts, where eight go side by side")
    return [quad_adjoint(features, access.at, access.add_to_corners)]


@cache
def membrane_faces_adjoint(features: Features, membrane_face: MembraneFaceLayout, keeps: bool) -> Adjoint:
    """Return the adjoint that gathers the bar of a particle's place from its faces.

    Args:
        keeps: whether a thread keeps the places where its particle's faces leave their bars.
    """
    take = membrane_faces_of(features, membrane_face).take

    @wp.func
    def kept_adjoint(t: Tables, params: Any, kept: Any, pulls: Any, area_vectors: Any, force_bars: Any):
        point_bar, _area = take(t, params, kept.places, pulls, area_vectors)
        return point_bar

    @wp.func
    def faces_adjoint(t: Tables, params: Any, pulls: Any, area_vectors: Any, force_bars: Any):
        point_bar, _area = take(t, params, wp.vec4i(), pulls, area_vectors)
        return point_bar

    return Adjoint(kept_adjoint if keeps else faces_adjoint, ("point",), _of_face(features, membrane_face))


def _of_face(features: Features, membrane_face: MembraneFaceLayout) -> Any:
    """Return the function that derives a face."""
    triangle_pairing = triangle_pairing_function(features)
    step, put, _, point_at, _ = membrane_face_places(membrane_face)
    triangles, mixed = membrane_face.triangles, membrane_face.mixed

    @wp.func
    def at_corner(
        t: Tables, face: wp.int32, corner: wp.int32, n: Any, d1: wp.vec3, d2: wp.vec3, b1: wp.vec3, b2: wp.vec3
    ):
        """Return the bars of both edges of the triangle at a corner, and of the numbers."""
        rest = rest_of(t.membranes.membrane_faces, face, corner)
        material = t.membranes.materials[t.membranes.membrane_faces.balloons[face]]
        there = not is_at_rest(d1, d2, rest)
        if wp.static(mixed):
            there = there and is_there(corner, rest)
        first = wp.vec3()
        second = wp.vec3()
        numbers = 0.0 * n
        if there:
            by_d1, by_d2, _v1, _v2, by_n, _rest, _material, _b1, _b2 = wp.grad(triangle_pairing)(
                d1, d2, wp.vec3(), wp.vec3(), n, rest, material, b1, b2
            )
            first = by_d1
            second = by_d2
            numbers = by_n
        return first, second, numbers

    @wp.func
    def turn_face(
        t: Tables, membrane_face: wp.int32, n: Any, points: Any, force_bars: Any, pulls: Any, area_vectors: Any
    ):
        count = t.membranes.membrane_faces.corners.shape[0]
        corners = four_ints_at(t.membranes.membrane_faces.corners, membrane_face)
        a = point_at(points, corners[0])
        b = point_at(points, corners[1])
        d = point_at(points, corners[3])
        of_a = point_at(force_bars, corners[0])
        of_b = point_at(force_bars, corners[1])
        of_d = point_at(force_bars, corners[3])
        by_ab, by_ad, numbers = at_corner(t, membrane_face, 0, n, b - a, d - a, of_b - of_a, of_d - of_a)
        on_a = -(by_ab + by_ad)
        on_b = by_ab
        on_d = by_ad
        if wp.static(triangles == 4):
            c = point_at(points, corners[2])
            of_c = point_at(force_bars, corners[2])
            by_bc, by_ba, of_second = at_corner(t, membrane_face, 1, n, c - b, a - b, of_c - of_b, of_a - of_b)
            by_cd, by_cb, of_third = at_corner(t, membrane_face, 2, n, d - c, b - c, of_d - of_c, of_b - of_c)
            by_da, by_dc, of_last = at_corner(t, membrane_face, 3, n, a - d, c - d, of_a - of_d, of_c - of_d)
            numbers = numbers + of_second + of_third + of_last
            on_a += by_ba + by_da
            on_b += by_cb - (by_bc + by_ba)
            on_d += by_cd - (by_da + by_dc)
            on_c = by_bc + by_dc - (by_cd + by_cb)
            put(pulls, area_vectors, step * (2 * count + membrane_face), on_c, wp.vec3())
        put(pulls, area_vectors, step * membrane_face, on_a, wp.vec3())
        put(pulls, area_vectors, step * (count + membrane_face), on_b, wp.vec3())
        put(pulls, area_vectors, step * (3 * count + membrane_face), on_d, wp.vec3())
        return numbers

    return turn_face

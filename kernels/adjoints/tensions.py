"""Changes of the tensions of eight triangles of membranes, by their edges' products, and of their energy, by numbers.

It is `loops.membranes.tension_function`, differentiated: see there, and `laws.tension_field` for taut, wrinkled and
slack triangles. The slopes of a law by trace and determinant are those of an energy, so that their changes are
symmetric: Warp's derivatives of the slopes times the changes of trace and determinant are the changes of the slopes.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.membranes import AT_REST
from balloon_warp.kernels.codegen import function_from
from balloon_warp.kernels.compose import choice_of_laws_of_few
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes3, Lanes4, Lanes5, number_in
from balloon_warp.kernels.laws.tension_field import LEAST_DET, NEVER_ZERO

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
    """Return at which state the law is asked, and how it changes."""
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
    """Return the columns of the numbers that tensions depend on: the thickness, and those that laws name."""
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
        work = 0.5 * (wp.cw_mul(found[0], change[0]) + wp.cw_mul(found[2], change[2])) + wp.cw_mul(found[1], change[1])
        by_few[0] = wp.cw_div(work, n[thickness])
        return found, by_few

    return changes_of_triangles

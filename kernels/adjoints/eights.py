"""Adjoints around eight particles of a world at once, in a CPU's vector registers: of Hooke's springs, and of areas.

They find the bars that `springs.hooke_back` and `areas.area_adjoint` find of one particle, rounded alike, from the same
tables, in which eight particles in a row have their entries side by side. Padding leads to the particle itself, and has
no part. Of particles that are not there nothing is kept.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.areas import CROSSES
from balloon_warp.kernels.tables import FanTable, SpringTable, Tables

EIGHT = 8
"""Particles that go side by side"""

HEAD = """
#pragma clang fp contract(off)
typedef float eight __attribute__((vector_size(32), aligned(4)));
typedef int eight_numbers __attribute__((vector_size(32), aligned(4)));
const float* const x = reinterpret_cast<const float*>(points.data.ptr);
const float* const b = reinterpret_cast<const float*>(bars.data.ptr);
struct Vectors { eight c[3]; };
const auto minus = [](const Vectors& p, const Vectors& q) {
    return Vectors{{p.c[0] - q.c[0], p.c[1] - q.c[1], p.c[2] - q.c[2]}};
};
const auto gathered = [](const float* from, const eight_numbers& at) {
    Vectors v;
    for (int c = 0; c < 3; ++c)
        for (int k = 0; k < 8; ++k)
            v.c[c][k] = from[3 * at[k] + c];
    return v;
};
float* const out = found.data + (size_t)(unsigned int)row * found.shape[1] + first_word;
for (int first = 0; first < count; first += 8) {
const int begin = table.slice_offsets.data[first >> 5] + (first & 31);
const int width = (table.slice_offsets.data[(first >> 5) + 1] - table.slice_offsets.data[first >> 5]) >> 5;
const eight_numbers own = eight_numbers{0, 1, 2, 3, 4, 5, 6, 7} + first;
const Vectors point = gathered(x, own), bar = gathered(b, own);
Vectors total = {};
"""
TAIL = """
for (int c = 0; c < 3; ++c)
    for (int k = 0; k < 8 && first + k < count; ++k)
        out[c * apart + first + k] += SCALE total.c[c][k];
}
"""
SPRINGS = """
eight* const sums = reinterpret_cast<eight*>(kinds.data.ptr);
const eight one = eight{} + 1.0f, none = eight{};
for (int slot = 0; slot < width; ++slot) {
    const float* const entry = reinterpret_cast<const float*>(table.entries.data + (unsigned int)(begin + 32 * slot));
    eight_numbers packed;
    eight length, scale = one;
    for (int k = 0; k < 8; ++k) {
        packed[k] = __builtin_bit_cast(int, entry[2 * k]);
        length[k] = entry[2 * k + 1];
    }
    if (VARY)
        for (int k = 0; k < 8; ++k)
            scale[k] = table.scales.data[(unsigned int)(begin + 32 * slot + k)];
    const eight_numbers end = packed >> 2, kind = packed & 3;
    const Vectors d = minus(gathered(x, end), point), apart = minus(bar, gathered(b, end));
    eight stiffness = none + constants[2];
    stiffness = kind == 1 ? none + constants[1] : stiffness;
    stiffness = scale * (kind == 0 ? none + constants[0] : stiffness);
    eight inverse = d.c[0] * d.c[0] + (d.c[1] * d.c[1] + (d.c[2] * d.c[2] + 1.0e-20f));
    for (int k = 0; k < 8; ++k)
        inverse[k] = 1.0f / sqrtf(inverse[k]);
    const eight along = d.c[0] * apart.c[0] + d.c[1] * apart.c[1] + d.c[2] * apart.c[2];
    const eight product = stiffness * length * inverse, pull = stiffness - product;
    const eight turned = product * inverse * inverse * along;
    for (int c = 0; c < 3; ++c)
        total.c[c] -= pull * apart.c[c] + turned * d.c[c];
    const eight half = 0.5f * scale * along * (1.0f - length * inverse);
    for (int c = 0; c < 3; ++c)
        sums[c] += kind == c && own < count ? half : none;
}
"""
AREAS = """
const auto add_cross = [&total](const Vectors& p, const Vectors& q) {
    total.c[0] += p.c[1] * q.c[2] - p.c[2] * q.c[1];
    total.c[1] += p.c[2] * q.c[0] - p.c[0] * q.c[2];
    total.c[2] += p.c[0] * q.c[1] - p.c[1] * q.c[0];
};
const auto plus = [](const Vectors& p, const Vectors& q) {
    return Vectors{{p.c[0] + q.c[0], p.c[1] + q.c[1], p.c[2] + q.c[2]}};
};
for (int slot = 0; slot < width; ++slot) {
    const auto* const quads_of = table.quads.data + (unsigned int)(begin + 32 * slot);
    eight_numbers others[3];
    for (int c = 0; c < 3; ++c)
        for (int k = 0; k < 8; ++k)
            others[c][k] = quads_of[k][c];
    const Vectors before = minus(gathered(x, others[0]), point), before_bar = minus(gathered(b, others[0]), bar);
    const Vectors across = plus(before, minus(gathered(x, others[1]), point));
    const Vectors across_bar = plus(before_bar, minus(gathered(b, others[1]), bar));
    add_cross(minus(minus(gathered(b, others[2]), bar), before_bar), across);
    add_cross(minus(minus(gathered(x, others[2]), point), before), across_bar);
}
"""


@cache
def springs_of_eight(features: Features) -> Any:
    """Return the function that adds the terms of springs to the bars of all places, and to those of constants."""
    text = HEAD + SPRINGS.replace("VARY", str(int(features.springs_vary))) + TAIL.replace("SCALE", "")

    @wp.func_native(text)
    def add(
        table: SpringTable,
        points: Any,
        bars: Any,
        count: wp.int32,
        constants: wp.vec3,
        found: wp.array2d[float],
        row: wp.int32,
        first_word: wp.int32,
        apart: wp.int32,
        kinds: Any,
    ):
        """Add to bars of places, and to those of constants over their scales, of which each end has half."""
        ...

    @wp.func
    def springs_back(
        t: Tables, points: Any, force_bars: Any, count: wp.int32, n: Any, found: wp.array2d[float], row: wp.int32,
        first_word: wp.int32, apart: wp.int32, kinds: Any,
    ):  # fmt: skip
        constants = wp.vec3(n[0], n[1], n[2])
        add(t.springs, points, force_bars, count, constants, found, row, first_word, apart, kinds)

    return springs_back


@cache
def areas_of_eight() -> Any:
    """Return the function that adds the terms of area vectors among quads to the bars of all places."""

    @wp.func_native(HEAD + AREAS + TAIL.replace("SCALE", "crosses *"))
    def add(
        table: FanTable,
        points: Any,
        bars: Any,
        count: wp.int32,
        crosses: float,
        found: wp.array2d[float],
        row: wp.int32,
        first_word: wp.int32,
        apart: wp.int32,
    ):
        """Add to bars of places."""
        ...

    @wp.func
    def areas_back(
        t: Tables, points: Any, area_vector_bars: Any, count: wp.int32, found: wp.array2d[float], row: wp.int32,
        first_word: wp.int32, apart: wp.int32,
    ):  # fmt: skip
        add(t.fans, points, area_vector_bars, count, CROSSES, found, row, first_word, apart)

    return areas_back


@wp.func
def sum_of_lanes(kinds: Any, kind: wp.int32):
    """Return the sum over all lanes of a kind of constants."""
    total = float(0.0)
    for lane in range(EIGHT):
        total += kinds[EIGHT * kind + lane]
    return total

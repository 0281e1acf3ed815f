"""Adjoints of the loops over a particle's springs, strings and hinges, and derivatives by the numbers of each.

Hooke's springs, and areas, also go around eight particles of a world at once, in a CPU's vector registers, with the
same bars, rounded alike, from the same tables, in which eight particles in a row have their entries side by side.
Padding leads to the particle itself, and has no part. Of particles that are not there nothing is kept.

Adjoint of the loop over a particle's hinges: torsion. A hinge's part in the sum over all particles of force . bar is
that of its four places, where the bar of a wing is the mean of its corners'. Warp derives it by the places; each
particle takes its own bar, and the first end of an edge the numbers'.

Adjoint of the loop over a particle's springs, whatever their laws. A spring between p and q pulls p with f = c d, along
d to q, and q with -f. Its part in the sum over all particles of force . bar is f . (bar of p - bar of q). That is
derived by d, by how fast d changes, and by the spring's numbers; Warp derives the coefficient c, which the laws give.
Both ends come to it: each takes the bars of its own place and velocity, and half of the numbers'. For Hooke's law alone
all is written out, with a single root.

Springs are read from tables, or are in slots, see `loops.springs`.

Derivatives by the numbers of each spring, and of each triangle of a membrane: a thread has one, once a substep. They
follow from the bars of the forces on particles, which are known once all particles have run backwards.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.adjoints.membranes import triangle_pairing_function
from balloon_warp.kernels.algebra import inverse_root, squared_length
from balloon_warp.kernels.compose import numbers_reader, params_functions, time_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.springs import FIRST_END, FIRST_WING, HOOKE, SECOND_WING, angle_beyond
from balloon_warp.kernels.loops.areas import CROSSES
from balloon_warp.kernels.loops.net_force import anchor_function, place_function, string_pull, wing_size
from balloon_warp.kernels.loops.springs import Slots, constant_of_kind
from balloon_warp.kernels.memory import float_at, int_at, pair_at, vector_at
from balloon_warp.kernels.phase import Adjoint
from balloon_warp.kernels.tables import (
    CHUNK,
    SLICE,
    FanTable,
    SpringTable,
    StringTable,
    Tables,
    first_entry,
    row_of_world,
)

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
    """Adjoint of springs: terms of the bars of all places and constants."""
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


@wp.func_native(HEAD + AREAS + TAIL.replace("SCALE", "crosses *"))
def add_areas_of_eight(
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
def areas_of_eight(
    t: Tables, points: Any, area_vector_bars: Any, count: wp.int32, found: wp.array2d[float], row: wp.int32,
    first_word: wp.int32, apart: wp.int32,
):  # fmt: skip
    """Add the terms of area vectors among quads to the bars of all places."""
    add_areas_of_eight(t.fans, points, area_vector_bars, count, CROSSES, found, row, first_word, apart)


@wp.func
def sum_of_lanes(kinds: Any, kind: wp.int32):
    """Return the sum over all lanes of a kind of constants."""
    total = float(0.0)
    for lane in range(EIGHT):
        total += kinds[EIGHT * kind + lane]
    return total


SECOND_END = wp.constant(1)


@cache
def hinge_adjoint(features: Features, at: Any) -> Adjoint:
    """Adjoint of hinges: gathers bars of a particle's place, and of its balloon's parameters."""
    laws, places_of_hinge = features.laws_on("hinge"), place_function(at)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def hinge_pairing(
        a: wp.vec3, b: wp.vec3, first: wp.vec3, second: wp.vec3, rest_angle: float, n: Any, a_bar: wp.vec3,
        b_bar: wp.vec3, first_bar: wp.vec3, second_bar: wp.vec3,
    ):  # fmt: skip
        bend = angle_beyond(a, b, first, second, rest_angle)
        return (
            wp.dot(laws(FIRST_END, a, b, first, second, bend, n), a_bar)
            + wp.dot(laws(SECOND_END, a, b, first, second, bend, n), b_bar)
            + wp.dot(laws(FIRST_WING, a, b, first, second, bend, n), first_bar)
            + wp.dot(laws(SECOND_WING, a, b, first, second, bend, n), second_bar)
        )

    @wp.func
    def hinges_adjoint(t: Tables, points: Any, params: Any, force_bars: Any):
        point_bar = wp.vec3()
        params_bar = Params()
        for entry in range(t.hinges.particle_offsets[params.number], t.hinges.particle_offsets[params.number + 1]):
            packed = t.hinges.particle_roles[entry]
            hinge = packed >> 2
            role = packed & 3
            a, b, first, second = places_of_hinge(t.hinges, points, hinge)
            a_bar, b_bar, first_bar, second_bar = places_of_hinge(t.hinges, force_bars, hinge)
            by_a, by_b, by_first, by_second, _rest, by_n, _a, _b, _first, _second = wp.grad(hinge_pairing)(
                a, b, first, second, t.hinges.rest_angles[hinge], params.n, a_bar, b_bar, first_bar, second_bar
            )
            if role == FIRST_END:
                point_bar += by_a
                params_bar.n += by_n
            elif role == SECOND_END:
                point_bar += by_b
            elif role == FIRST_WING:
                point_bar += by_first / float(wing_size(t.hinges, hinge, 0))
            else:
                point_bar += by_second / float(wing_size(t.hinges, hinge, 1))
        return point_bar, params_bar

    return Adjoint(hinges_adjoint, ("point", "params"))


StringBars = wp.types.vector(length=5, dtype=wp.float64)
"""Derivatives by a string's anchor, length and stiffness"""


@cache
def string_adjoint(features: Features) -> Adjoint:
    """Adjoint of a particle's strings: bars of its place and velocity."""
    pull_of_string = string_pull(features)

    @wp.func
    def string_pairing(
        point: wp.vec3, velocity: wp.vec3, bar: wp.vec3, strings: StringTable, world: wp.int32, string: wp.int32,
        n: Any, step_seconds: float, time: float,
    ):  # fmt: skip
        return wp.dot(pull_of_string(strings, world, string, point, velocity, n, step_seconds, time), bar)

    @wp.func
    def strings_adjoint(t: Tables, params: Any, point: wp.vec3, velocity: wp.vec3, time: float, force_bar: wp.vec3):
        point_bar = wp.vec3()
        velocity_bar = wp.vec3()
        for held in range(int_at(t.strings.offsets, params.number), int_at(t.strings.offsets, params.number + 1)):
            by_point, by_velocity, _bar, _strings, _world, _string, _n, _step, _time = wp.grad(string_pairing)(
                point,
                velocity,
                force_bar,
                t.strings,
                params.world,
                t.strings.order[held][0],
                params.n,
                t.step_seconds,
                time,
            )
            point_bar += by_point
            velocity_bar += by_velocity
        return point_bar, velocity_bar

    return Adjoint(strings_adjoint, ("point", "velocity"))


@cache
def strings_back_kernel(features: Features) -> Any:
    """Backward kernel of strings: bars of each anchor, length and stiffness."""
    coefficient, read_numbers = features.laws_on("string"), numbers_reader(features.columns)
    anchor_at = anchor_function(features)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def strings_back(
        t: Tables, frame: wp.array[wp.int32], time_in_frame: float, points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3], force_bars: wp.array2d[wp.vec3], bars: wp.array2d[StringBars],
    ):  # fmt: skip
        """Add the bars of a substep; a thread a (world, string)."""
        world, held = wp.tid()
        particle = t.strings.particles[held]
        string = t.strings.order[held][0]
        n = read_numbers(t, world, t.particles.balloon[particle])
        time = time_of(t, frame, time_in_frame)
        d = anchor_at(t.strings, world, string, time) - points[world, particle]
        length = t.strings.lengths[row_of_world(world, t.strings.lengths.shape[0]), string]
        stiffness = t.strings.stiffness[row_of_world(world, t.strings.stiffness.shape[0]), string]
        velocity = velocities[world, particle]
        squared = squared_length(d)
        opening = -wp.dot(velocity, d)
        product = stiffness * length
        pull = coefficient(squared, opening, length, stiffness, product, t.step_seconds, time, n)
        by_squared, by_opening, by_length, by_k, by_product, _step, _time, _n = wp.grad(coefficient)(
            squared, opening, length, stiffness, product, t.step_seconds, time, n
        )
        bar = force_bars[world, particle]
        along = wp.dot(d, bar)
        by_anchor = pull * bar + along * (2.0 * by_squared * d - by_opening * velocity)
        bars[world, string] += StringBars(
            wp.float64(by_anchor[0]), wp.float64(by_anchor[1]), wp.float64(by_anchor[2]),
            wp.float64(along * (by_length + stiffness * by_product)), wp.float64(along * (by_k + length * by_product)),
        )  # fmt: skip

    return strings_back


KINDS = ("structural", "shear", "flexion")


@cache
def spring_adjoint(features: Features, at: Any, slots: Slots | None = None) -> Adjoint:
    """Return the adjoint that gathers bars of a particle's place and velocity, and of its balloon's numbers."""
    if features.of_kind("spring") == (HOOKE,):
        return _hooke_in_slots(features, at, slots) if slots else _of_hooke(features, at)
    return _of_laws(features, at)


@wp.func
def hooke_back(point_bar: wp.vec3, d: wp.vec3, bar: wp.vec3, stiffness: float, product: float, rest_length: float):
    """Bars of the near end's place, with a spring's term, and of the spring's constant over its scale.

    Args:
        bar: of the near end's force, less that of the far end's.
        product: of stiffness and rest length [N].
    """
    inverse = inverse_root(squared_length(d))
    along = wp.dot(d, bar)
    pull = stiffness - product * inverse
    turned = product * inverse * inverse * inverse * along
    moved = wp.vec3(
        point_bar[0] - pull * bar[0] - turned * d[0],
        point_bar[1] - pull * bar[1] - turned * d[1],
        point_bar[2] - pull * bar[2] - turned * d[2],
    )  # two instructions a component: each takes away a product
    return moved, 0.5 * along * (1.0 - rest_length * inverse)


def _of_hooke(features: Features, at: Any) -> Adjoint:
    @wp.func
    def hooke_adjoint(t: Tables, points: Any, params: Any, point: wp.vec3, force_bar: wp.vec3, force_bars: Any):
        point_bar = wp.vec3()
        structural = float(0.0)
        shear = float(0.0)
        flexion = float(0.0)
        begin = first_entry(t.springs.slice_offsets, params.number)
        for chunk in range(begin, begin + SLICE * int_at(t.springs.valences, params.number), SLICE * CHUNK):
            for slot in range(CHUNK):
                entry = chunk + SLICE * slot
                spring = pair_at(t.springs.entries, entry)
                end = wp.cast(spring[0], wp.int32)
                kind = end & 3
                scale = float(1.0)
                if wp.static(features.springs_vary):
                    scale = float_at(t.springs.scales, entry)
                d = at(points, end >> 2) - point  # padding leads to the particle itself: no force, and no bar
                bar = force_bar - at(force_bars, end >> 2)
                stiffness = constant_of_kind(params.n, kind) * scale
                moved, half = hooke_back(point_bar, d, bar, stiffness, stiffness * spring[1], spring[1])
                point_bar = moved
                half *= scale
                structural += wp.where(kind == 0, half, 0.0)
                shear += wp.where(kind == 1, half, 0.0)
                flexion += wp.where(kind == 2, half, 0.0)
        return point_bar, structural, shear, flexion

    return Adjoint(hooke_adjoint, ("point", *KINDS), of_eight=springs_of_eight(features))


def _hooke_in_slots(features: Features, at: Any, kind_slots: Slots) -> Adjoint:
    shear_begin, flexion_begin = kind_slots[0], kind_slots[0] + kind_slots[1]
    slots = sum(kind_slots)

    @wp.func
    def of_slot(
        point_bar: wp.vec3,
        points: Any,
        springs: Any,
        slot: wp.int32,
        constant: float,
        point: wp.vec3,
        bar: wp.vec3,
        bars: Any,
    ):
        d = at(points, springs.neighbors[slot]) - point  # padding leads to the particle itself: no force, and no bar
        scale = float(1.0)
        stiffness = constant
        if wp.static(features.springs_vary):
            scale = springs.scales[slot]
            stiffness = springs.stiffness[slot]
        moved, half = hooke_back(
            point_bar,
            d,
            bar - at(bars, springs.neighbors[slot]),
            stiffness,
            springs.tensions[slot],
            springs.lengths[slot],
        )
        return moved, half * scale

    @wp.func
    def hooke_adjoint(points: Any, params: Any, springs: Any, point: wp.vec3, force_bar: wp.vec3, force_bars: Any):
        point_bar = wp.vec3()
        structural = float(0.0)
        shear = float(0.0)
        flexion = float(0.0)
        for slot in range(shear_begin):
            point_bar, half = of_slot(point_bar, points, springs, slot, params.n[0], point, force_bar, force_bars)
            structural += half
        for slot in range(shear_begin, flexion_begin):
            point_bar, half = of_slot(point_bar, points, springs, slot, params.n[1], point, force_bar, force_bars)
            shear += half
        for slot in range(flexion_begin, slots):
            point_bar, half = of_slot(point_bar, points, springs, slot, params.n[2], point, force_bar, force_bars)
            flexion += half
        return point_bar, structural, shear, flexion

    return Adjoint(hooke_adjoint, ("point", *KINDS))


def _of_laws(features: Features, at: Any) -> Adjoint:
    coefficient = features.laws_on("spring")
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type
    moving = features.needs("spring", "opening")

    @wp.func
    def springs_adjoint(
        t: Tables, points: Any, velocities: Any, params: Any, point: wp.vec3, velocity: wp.vec3, time: float,
        force_bar: wp.vec3, force_bars: Any,
    ):  # fmt: skip
        point_bar = wp.vec3()
        velocity_bar = wp.vec3()
        params_bar = Params()
        structural = float(0.0)
        shear = float(0.0)
        flexion = float(0.0)
        begin = first_entry(t.springs.slice_offsets, params.number)
        for chunk in range(begin, begin + SLICE * int_at(t.springs.valences, params.number), SLICE * CHUNK):
            for slot in range(CHUNK):
                entry = chunk + SLICE * slot
                spring = pair_at(t.springs.entries, entry)
                packed = wp.cast(spring[0], wp.int32)
                kind = packed & 3
                end = packed >> 2
                if end != params.number:  # or else it fills up
                    scale = float(1.0)
                    if wp.static(features.springs_vary):
                        scale = float_at(t.springs.scales, entry)
                    d = at(points, end) - point
                    bar = force_bar - at(force_bars, end)
                    rate = wp.vec3()
                    if wp.static(moving):
                        rate = vector_at(velocities, end) - velocity
                    stiffness = constant_of_kind(params.n, kind) * scale
                    squared = squared_length(d)
                    opening = wp.dot(rate, d)
                    product = stiffness * spring[1]
                    pull = coefficient(squared, opening, spring[1], stiffness, product, t.step_seconds, time, params.n)
                    by_squared, by_opening, _length, by_k, by_product, _step, _time, by_n = wp.grad(coefficient)(
                        squared, opening, spring[1], stiffness, product, t.step_seconds, time, params.n
                    )
                    along = wp.dot(d, bar)
                    point_bar -= pull * bar + along * (2.0 * by_squared * d + by_opening * rate)
                    velocity_bar -= (along * by_opening) * d
                    params_bar.n += (0.5 * along) * by_n
                    half = 0.5 * scale * along * (by_k + spring[1] * by_product)
                    structural += wp.where(kind == 0, half, 0.0)
                    shear += wp.where(kind == 1, half, 0.0)
                    flexion += wp.where(kind == 2, half, 0.0)
        return point_bar, velocity_bar, structural, shear, flexion, params_bar

    return Adjoint(springs_adjoint, ("point", "velocity", *KINDS, "params"))


@cache
def springs_back_kernel(features: Features) -> Any:
    """Backward kernel of springs: bars of each rest length and constant."""
    coefficient = features.laws_on("spring")
    read_numbers = numbers_reader(features.columns)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def springs_back(
        t: Tables,
        frame: wp.array[wp.int32],
        time_in_frame: float,
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        force_bars: wp.array2d[wp.vec3],
        bars: wp.array2d[wp.vec2d],
    ):
        """Add the bars of a substep; a thread a (world, spring)."""
        world, spring = wp.tid()
        p = t.pairs.particles[spring][0]
        q = t.pairs.particles[spring][1]
        n = read_numbers(t, world, t.particles.balloon[p])
        stiffness = constant_of_kind(n, t.pairs.kinds[spring]) * t.pairs.scales[spring]
        length = t.pairs.rest_lengths[spring]
        d = points[world, q] - points[world, p]
        opening = wp.dot(velocities[world, q] - velocities[world, p], d)
        time = time_of(t, frame, time_in_frame)
        _squared, _opening, by_length, by_k, by_product, _step, _time, _n = wp.grad(coefficient)(
            squared_length(d), opening, length, stiffness, stiffness * length, t.step_seconds, time, n
        )
        along = wp.dot(d, force_bars[world, p] - force_bars[world, q])
        by_length = along * (by_length + stiffness * by_product)
        bars[world, spring] += wp.vec2d(wp.float64(by_length), wp.float64(along * (by_k + length * by_product)))

    return springs_back


@cache
def triangles_back_kernel(features: Features) -> Any:
    """Backward kernel of membranes: bars of each triangle's rest metric and area."""
    triangle_pairing = triangle_pairing_function(features)
    read_numbers = numbers_reader(features.columns)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def triangles_back(
        t: Tables,
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        force_bars: wp.array2d[wp.vec3],
        bars: wp.array2d[wp.vec4d],
    ):
        """Add the bars of a substep; a thread a (world, triangle)."""
        world, triangle = wp.tid()
        corners = t.membranes.corners[triangle]
        rest = t.membranes.corner_rests[triangle]
        balloon = t.particles.balloon[corners[0]]
        d1 = points[world, corners[1]] - points[world, corners[0]]
        d2 = points[world, corners[2]] - points[world, corners[0]]
        v1 = velocities[world, corners[1]] - velocities[world, corners[0]]
        v2 = velocities[world, corners[2]] - velocities[world, corners[0]]
        bar = force_bars[world, corners[0]]
        _d1, _d2, _v1, _v2, _n, by_rest, _material, _b1, _b2 = wp.grad(triangle_pairing)(
            d1, d2, v1, v2, read_numbers(t, world, balloon), rest, t.membranes.materials[balloon],
            force_bars[world, corners[1]] - bar, force_bars[world, corners[2]] - bar,
        )  # fmt: skip
        if wp.isfinite(by_rest):  # exactly at rest, the root of how far stretches differ has no slope
            bars[world, triangle] += wp.vec4d(by_rest)

    return triangles_back

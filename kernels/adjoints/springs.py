"""Adjoints of the loops over a particle's springs, strings and hinges.

Adjoint of the loop over a particle's hinges: torsion.

A hinge's part in the sum over all particles of force . bar is that of its four places, where the bar of a wing is the
mean of its corners'. Warp derives it by the places; each particle takes its own bar, and the first end of an edge the
numbers'.

Adjoint of the loop over a particle's springs, whatever their laws.

A spring between p and q pulls p with f = c d, along d to q, and q with -f. Its part in the sum over all particles of
force . bar is f . (bar of p - bar of q). That is derived by d, by how fast d changes, and by the spring's numbers; Warp
derives the coefficient c, which the laws give. Both ends come to it: each takes the bars of its own place and velocity,
and half of the numbers'. For Hooke's law alone all is written out, with a single root.

Springs are read from tables, or are in slots, see `loops.slots`.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.eights import springs_of_eight
from balloon_warp.kernels.algebra import inverse_root, squared_length
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.springs import FIRST_END, FIRST_WING, HOOKE, SECOND_WING, angle_beyond
from balloon_warp.kernels.loops.net_force import anchor_function, place_function, string_pull, wing_size
from balloon_warp.kernels.loops.slots import Slots
from balloon_warp.kernels.loops.springs import constant_of_kind
from balloon_warp.kernels.memory import float_at, int_at, pair_at, vector_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.params import numbers_reader, params_functions, time_of
from balloon_warp.kernels.phase import Adjoint
from balloon_warp.kernels.tables import CHUNK, SLICE, StringTable, Tables, first_entry, row_of_world

SECOND_END = wp.constant(1)


@cache
def hinge_adjoint(features: Features, at: Any) -> Adjoint:
    """Return the adjoint that gathers bars of a particle's place, and of its balloon's numbers."""
    laws, places_of_hinge = features.laws_on("hinge"), place_function(at)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def work_of_hinge(
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
            by_a, by_b, by_first, by_second, _rest, by_n, _a, _b, _first, _second = wp.grad(work_of_hinge)(
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
    """Return the adjoint of a particle's strings, for its place and its velocity."""
    pull_of_string = string_pull(features)

    @wp.func
    def work_of_string(
        point: wp.vec3, velocity: wp.vec3, bar: wp.vec3, strings: StringTable, world: wp.int32, string: wp.int32,
        n: Any, step_seconds: float, time: float,
    ):  # fmt: skip
        return wp.dot(pull_of_string(strings, world, string, point, velocity, n, step_seconds, time), bar)

    @wp.func
    def strings_adjoint(t: Tables, params: Any, point: wp.vec3, velocity: wp.vec3, time: float, force_bar: wp.vec3):
        point_bar = wp.vec3()
        velocity_bar = wp.vec3()
        for held in range(int_at(t.strings.offsets, params.number), int_at(t.strings.offsets, params.number + 1)):
            by_point, by_velocity, _bar, _strings, _world, _string, _n, _step, _time = wp.grad(work_of_string)(
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
    """Return the kernel that adds to the bars of each string's anchor, length and stiffness."""
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
    """Return the bar of the near end's place with a spring's term, and the bar of its constant, over its scale.

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

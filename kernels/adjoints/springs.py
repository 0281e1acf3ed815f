"""Adjoint of the loop over a particle's springs, whatever their laws.

A spring between p and q pulls p with f = c d, along d to q, and q with -f. Its part in the sum over all particles of
force . bar is f . (bar of p - bar of q). That is derived by d, by how fast d changes, and by the spring's numbers; Warp
derives the coefficient c, which the laws give. Both ends come to it: each takes the bars of its own place and velocity,
and half of the numbers'. For Hooke's law alone all is written out, with a single root.

Springs are read from tables, or are in slots, see `loops.slots`.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.adjoints.eights import springs_of_eight
from balloon_warp.kernels.algebra import inverse_root, squared_length
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.hooke import HOOKE
from balloon_warp.kernels.loops.slots import Slots
from balloon_warp.kernels.loops.springs import constant_of_kind
from balloon_warp.kernels.memory import float_at, int_at, pair_at, vector_at
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.tables import CHUNK, SLICE, Tables, first_entry

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

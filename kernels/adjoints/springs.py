"""Adjoint of the loop over a particle's springs, whatever their laws.

A spring between p and q pulls p with f = c d, along d to q, and q with -f. Its part in the sum over all particles of
force . bar is f . (bar of p - bar of q). That is derived by d, by how fast d changes, and by the spring's numbers; Warp
derives the coefficient c, which the laws give. Both ends come to it: each takes what is its own of places and
velocities, and half of the numbers'. For Hooke's law alone all is written out, with a single root.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.algebra import inverse_root, squared_length
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.hooke import HOOKE
from balloon_warp.kernels.loops.springs import constant_of_kind
from balloon_warp.kernels.memory import float_at, int_at, pair_at, vector_at
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.tables import CHUNK, SLICE, Tables, first_entry

KINDS = ("structural", "shear", "flexion")


@cache
def spring_adjoint(features: Features, at: Any) -> Adjoint:
    """Return the adjoint that gathers bars of a particle's place and velocity, and of its balloon's numbers."""
    return _of_hooke(features, at) if features.of_kind("spring") == (HOOKE,) else _of_laws(features, at)


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
                inverse = inverse_root(squared_length(d))
                stretched = 1.0 - spring[1] * inverse
                along = wp.dot(d, bar)
                turned = stiffness * spring[1] * inverse * inverse * inverse * along
                point_bar -= (stiffness * stretched) * bar + turned * d
                half = 0.5 * scale * along * stretched
                structural += wp.where(kind == 0, half, 0.0)
                shear += wp.where(kind == 1, half, 0.0)
                flexion += wp.where(kind == 2, half, 0.0)
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

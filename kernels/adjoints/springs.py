"""Adjoint of the loop over a particle's springs, whatever their laws.

A spring between p and q pulls p with f and q with -f. Its part in the sum over all particles of force . bar is
f . (bar of p - bar of q), and Warp derives that by the vector between them, by how fast that changes, and by the
spring's numbers. Both ends come to it: each takes what is its own of places and velocities, and half of the numbers'.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.algebra import squared_length
from balloon_warp.kernels.loops.springs import constant_of_kind
from balloon_warp.kernels.memory import float_at, int_at, pair_at, vector_at
from balloon_warp.kernels.own import own_functions
from balloon_warp.kernels.tables import CHUNK, SLICE, Tables, first_entry
from balloon_warp.kernels.traits import Traits


@cache
def spring_work(traits: Traits) -> Any:
    """Return the function for a spring's force times a bar."""
    coefficient = traits.laws_on("spring")

    @wp.func
    def work_of_spring(
        d: wp.vec3,
        rate: wp.vec3,
        stiffness: float,
        length: float,
        step_seconds: float,
        time: float,
        n: Any,
        bar: wp.vec3,
    ):
        """Return the force of a spring on one end times a bar; `rate` is how fast `d` changes."""
        return wp.dot(d, bar) * coefficient(
            squared_length(d), wp.dot(rate, d), length, stiffness, stiffness * length, step_seconds, time, n
        )

    return work_of_spring


@cache
def spring_adjoint(traits: Traits, at: Any) -> Adjoint:
    """Return the adjoint that gathers bars of a particle's place and velocity, and of its balloon's numbers."""
    work_of_spring = spring_work(traits)
    Own, _ = own_functions(traits.columns, traits.balloons)  # noqa: N806 - a type
    moving = traits.needs("spring", "opening")
    numbered = any(law.parameters for law in traits.of_kind("spring"))

    @wp.func
    def springs_adjoint(
        t: Tables, points: Any, velocities: Any, own: Any, point: wp.vec3, velocity: wp.vec3, time: float,
        force_bar: wp.vec3, force_bars: Any,
    ):  # fmt: skip
        point_bar = wp.vec3()
        velocity_bar = wp.vec3()
        own_bar = Own()
        structural = float(0.0)
        shear = float(0.0)
        flexion = float(0.0)
        begin = first_entry(t.springs.slice_offsets, own.number)
        for chunk in range(begin, begin + SLICE * int_at(t.springs.valences, own.number), SLICE * CHUNK):
            for slot in range(CHUNK):
                entry = chunk + SLICE * slot
                spring = pair_at(t.springs.entries, entry)
                packed = wp.cast(spring[0], wp.int32)
                kind = packed & 3
                end = packed >> 2
                if end != own.number:  # or else it fills up
                    scale = float(1.0)
                    if wp.static(traits.springs_vary):
                        scale = float_at(t.springs.scales, entry)
                    rate = wp.vec3()
                    if wp.static(moving):
                        rate = vector_at(velocities, end) - velocity
                    by_d, by_rate, by_stiffness, _length, _step, _time, by_n, _bar = wp.grad(work_of_spring)(
                        at(points, end) - point, rate, constant_of_kind(own.n, kind) * scale, spring[1],
                        t.step_seconds, time, own.n, force_bar - at(force_bars, end),
                    )  # fmt: skip
                    point_bar -= by_d
                    if wp.static(moving):
                        velocity_bar -= by_rate
                    if wp.static(numbered):
                        own_bar.n += 0.5 * by_n
                    half = 0.5 * scale * by_stiffness
                    structural += wp.where(kind == 0, half, 0.0)
                    shear += wp.where(kind == 1, half, 0.0)
                    flexion += wp.where(kind == 2, half, 0.0)
        own_bar.n[0] += structural
        own_bar.n[1] += shear
        own_bar.n[2] += flexion
        return point_bar, velocity_bar, own_bar

    return Adjoint(springs_adjoint, ("point", "velocity", "own"))

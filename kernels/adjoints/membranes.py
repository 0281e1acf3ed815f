"""Adjoint of the loop over a particle's triangles of rubber or film, whatever the material.

A triangle pulls its corners with forces whose sum is zero. Its part in the sum over all particles of force . bar is
that of two of them times how their bars differ from the first corner's, and Warp derives that by edges, by how fast
they change, and by the material's numbers. All three corners come to it: each takes its own bar, and a third of the
numbers'.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.tension_field import mixed_stretch
from balloon_warp.kernels.loops.membranes import triangle_pull
from balloon_warp.kernels.memory import four_floats_at, int_pair_at, vector_at
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.tables import SLICE, Tables, first_entry

AT_REST = wp.constant(1.0e-4)
"""Largest change of G M from 1 that counts as rest: float32 does not tell which side of the law's kink it is on"""


@wp.func
def is_unstretched(mixed: wp.vec4):
    """Return whether a triangle of this G M is at rest, without tension, so that its bars are 0.

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
def triangle_work(features: Features) -> Any:
    """Return the function for a triangle's forces times bars."""
    pull_of_triangle = triangle_pull(features)

    @wp.func
    def work_of_triangle(
        d1: wp.vec3, d2: wp.vec3, v1: wp.vec3, v2: wp.vec3, n: Any, rest: wp.vec4, material: wp.int32, b1: wp.vec3,
        b2: wp.vec3,
    ):  # fmt: skip
        """Return the forces on the corners at the ends of both edges, times how their bars differ from the first's."""
        _pull, first, second = pull_of_triangle(d1, d2, v1, v2, rest, material, n)
        return wp.dot(first, b1) + wp.dot(second, b2)

    return work_of_triangle


@cache
def membrane_adjoint(features: Features, at: Any) -> Adjoint:
    """Return the adjoint that gathers bars of a particle's place and velocity, and of its balloon's numbers."""
    work_of_triangle = triangle_work(features)
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
                by_d1, by_d2, by_v1, by_v2, by_n, _rest, _material, _b1, _b2 = wp.grad(work_of_triangle)(
                    d1, d2, v1, v2, params.n, rest, material,
                    at(force_bars, others[0]) - force_bar, at(force_bars, others[1]) - force_bar,
                )  # fmt: skip
                point_bar -= by_d1 + by_d2
                if wp.static(features.viscous):
                    velocity_bar -= by_v1 + by_v2
                params_bar.n += (1.0 / 3.0) * by_n
        return point_bar, velocity_bar, params_bar

    return Adjoint(triangles_adjoint, ("point", "velocity", "params"))

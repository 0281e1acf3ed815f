"""Adjoint of the load of a liquid on faces, which their corners share.

A face's part in the sum over all particles of load . bar is that of the triangles of its fan: the loads of their
corners times those corners' bars, and the load of the center times the mean of all corners' bars. Warp derives that by
the triangle's corners and by the level; each corner of the face takes its own bar.
"""

from collections.abc import Sequence
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import Five
from balloon_warp.kernels.laws.water import corner_load, triangle_load
from balloon_warp.kernels.loops.areas import face_measures
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.phase import Look, Phase
from balloon_warp.kernels.tables import Tables


@wp.func
def work_of_triangle(
    a: wp.vec3, b: wp.vec3, center: wp.vec3, level: float, up: wp.vec3, a_bar: wp.vec4, b_bar: wp.vec4,
    center_bar: wp.vec4,
):  # fmt: skip
    """Return the loads on the corners of a triangle of a fan, times their bars."""
    load = triangle_load(a, b, center, level, up)
    return (
        wp.dot(corner_load(load, load.moments[0], load.areas[0]), a_bar)
        + wp.dot(corner_load(load, load.moments[1], load.areas[1]), b_bar)
        + wp.dot(corner_load(load, load.moments[2], load.areas[2]), center_bar)
    )


def soak_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of the load on the faces around a particle."""
    center_of_face, _ = face_measures(look.at)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type
    at, level = look.at, features.columns.places["water_level"]

    @wp.func
    def soak_adjoint(t: Tables, points: Any, params: Any, water_load_bars: Any):
        point_bar = wp.vec3()
        params_bar = Params()
        for incidence in range(t.faces.particle_offsets[params.number], t.faces.particle_offsets[params.number + 1]):
            face = t.faces.around_particles[incidence]
            begin = t.faces.offsets[face]
            end = t.faces.offsets[face + 1]
            part = 1.0 / float(end - begin)
            center = center_of_face(t.faces, points, face)
            mean_bar = wp.vec4()
            for corner in range(begin, end):
                mean_bar += part * water_load_bars[t.faces.particles[corner]]
            p = t.faces.particles[end - 1]
            for corner in range(begin, end):
                q = t.faces.particles[corner]
                by_p, by_q, by_center, by_level, _up, _p, _q, _center = wp.grad(work_of_triangle)(
                    at(points, p), at(points, q), center, params.n[level], t.up, water_load_bars[p],
                    water_load_bars[q], mean_bar,
                )  # fmt: skip
                point_bar += part * by_center
                if p == params.number:
                    point_bar += by_p
                    params_bar.n[level] += by_level  # each triangle once
                if q == params.number:
                    point_bar += by_q
                p = q
        return point_bar, params_bar

    return (Adjoint(soak_adjoint, ("point", "params")),)


def lift_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of a balloon's value that every particle reads: the sum of the bars of all of them."""

    @wp.func
    def lift_adjoint(t: Tables, params: Any, upheld_bars: Any):
        total = Five()
        for particle in range(t.particles.offsets[params.balloon], t.particles.offsets[params.balloon + 1]):
            total += upheld_bars[particle]
        return total

    return (Adjoint(lift_adjoint, ("afloat",)),)

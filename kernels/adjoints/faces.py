"""Adjoint of the forces on faces, which their corners share: the air's lift and drag, and laws of one's own.

A face's part in the sum over all particles of force . bar is its force times the mean of its corners' bars. Warp
derives that by the face's center, area vector and velocity; each corner takes its own bar.
"""

from collections.abc import Sequence
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.areas import face_measures
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.phase import Look, Phase
from balloon_warp.kernels.tables import Tables


def bear_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoints of the forces on the faces around a particle."""
    laws, (center_of_face, area_vector_of_face) = features.laws_on("face"), face_measures(look.at)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type
    at, velocity_at, moving = look.at, look.velocity_at, features.needs("face", "velocity")

    @wp.func
    def passed_on(force_bar: wp.vec3):
        return force_bar

    @wp.func
    def work_of_face(
        center: wp.vec3, area_vector: wp.vec3, velocity: wp.vec3, up: wp.vec3, step_seconds: float, time: float, n: Any,
        bar: wp.vec3,
    ):  # fmt: skip
        return wp.dot(laws(center, area_vector, velocity, up, step_seconds, time, n), bar)

    @wp.func
    def faces_adjoint(t: Tables, points: Any, velocities: Any, params: Any, time: float, force_bars: Any):
        point_bar = wp.vec3()
        velocity_bar = wp.vec3()
        params_bar = Params()
        for incidence in range(t.faces.particle_offsets[params.number], t.faces.particle_offsets[params.number + 1]):
            face = t.faces.around_particles[incidence]
            begin = t.faces.offsets[face]
            end = t.faces.offsets[face + 1]
            part = 1.0 / float(end - begin)
            velocity = wp.vec3()
            bar = wp.vec3()
            for corner in range(begin, end):
                bar += part * at(force_bars, t.faces.particles[corner])
                if wp.static(moving):
                    velocity += part * velocity_at(velocities, t.faces.particles[corner])
            center = center_of_face(t.faces, points, face)
            area_vector = area_vector_of_face(t.faces, points, face, center)
            by_center, by_area, by_velocity, _up, _step, _time, by_n, _bar = wp.grad(work_of_face)(
                center, area_vector, velocity, t.up, t.step_seconds, time, params.n, bar
            )
            for corner in range(begin, end):
                if t.faces.particles[corner] == params.number:
                    before = t.faces.particles[wp.where(corner == begin, end, corner) - 1]
                    after = t.faces.particles[wp.where(corner == end - 1, begin, corner + 1)]
                    chord = at(points, after) - at(points, before)
                    point_bar += part * by_center + 0.5 * wp.cross(chord, by_area)
                    velocity_bar += part * by_velocity
                    params_bar.n += part * by_n
        return point_bar, velocity_bar, params_bar

    return Adjoint(passed_on, ("force",)), Adjoint(faces_adjoint, ("point", "velocity", "params"))

"""Adjoints of the net force on a particle: laws, faces, liquids, and area vectors.

Adjoint of the forces on faces, which their corners share: the air's lift and drag, and laws of one's own.

A face's part in the sum over all particles of force . bar is its force times the mean of its corners' bars. Warp
derives that by the face's center, area vector and velocity; each corner takes its own bar.

Adjoint of the load of a liquid on faces, which their corners share.

A face's part in the sum over all particles of load . bar is that of the triangles of its fan: the loads of their
corners times those corners' bars, and the load of the center times the mean of all corners' bars. Warp derives that by
the triangle's corners and by the level; each corner of the face takes its own bar.

Adjoint of area vectors: the second derivative of a closed balloon's volume, times a bar.

An area vector a is the gradient of the volume V, whose second derivative is symmetric. So the sum over all particles of
a' . bar, derived by a place x, is the derivative of x's own area vector along the bars: it is gathered around x, in
the loop that finds a. Bars count relative to that of x, as places do, since a common shift leaves a as it is.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.eights import areas_of_eight
from balloon_warp.kernels.adjoints.lanes import pull_of_eight
from balloon_warp.kernels.adjoints.membranes import membrane_adjoint, membrane_faces_adjoint
from balloon_warp.kernels.adjoints.springs import hinge_adjoint, spring_adjoint, string_adjoint
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import Five
from balloon_warp.kernels.laws.water import corner_load, triangle_load
from balloon_warp.kernels.loops.areas import CROSSES, face_measures, plus_cross
from balloon_warp.kernels.memory import triple_at
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.phase import Adjoint, Look, Phase
from balloon_warp.kernels.tables import SLICE, FanTable, Tables, first_entry


def add_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint: the bar of the force before is that of the force after it."""

    @wp.func
    def added_adjoint(force_bar: wp.vec3):
        return force_bar

    return (Adjoint(added_adjoint, ("force",)),)


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


@cache
def area_adjoint(quads: bool, at: Any) -> Adjoint:
    """Return the adjoint that gathers the bar of a particle's place from bars of area vectors."""

    @wp.func
    def back_in_quads(fans: FanTable, points: Any, bars: Any, particle: wp.int32, point: wp.vec3, bar: wp.vec3):
        """Return the bar of the place of a particle whose faces are all quads."""
        total = wp.vec3()
        begin = first_entry(fans.slice_offsets, particle)
        for entry in range(begin, begin + SLICE * fans.counts[particle], SLICE):
            others = triple_at(fans.quads, entry)
            before = at(points, others[0]) - point
            before_bar = at(bars, others[0]) - bar
            across = before + (at(points, others[1]) - point)
            across_bar = before_bar + (at(bars, others[1]) - bar)
            chord = at(points, others[2]) - point - before
            chord_bar = at(bars, others[2]) - bar - before_bar
            total = plus_cross(plus_cross(total, chord_bar, across), chord, across_bar)
        return CROSSES * total

    @wp.func
    def back_in_faces(fans: FanTable, points: Any, bars: Any, particle: wp.int32, point: wp.vec3, bar: wp.vec3):
        """Return the bar of the place of a particle with faces of any number of corners."""
        total = wp.vec3()
        for corner in range(fans.offsets[particle], fans.offsets[particle + 1]):
            begin = fans.begins[corner]
            end = fans.begins[corner + 1]
            first = at(points, fans.particles[begin]) - point
            first_bar = at(bars, fans.particles[begin]) - bar
            arm = first
            arm_bar = first_bar
            arms = first
            arms_bar = first_bar
            double_area = wp.vec3()
            for other in range(begin + 1, end):
                next_arm = at(points, fans.particles[other]) - point
                next_bar = at(bars, fans.particles[other]) - bar
                double_area += wp.cross(arm_bar, next_arm) + wp.cross(arm, next_bar)
                arms += next_arm
                arms_bar += next_bar
                arm = next_arm
                arm_bar = next_bar
            turned = wp.cross(first_bar - arm_bar, arms) + wp.cross(first - arm, arms_bar)
            total += (double_area + turned) * (0.5 / (3.0 * float(end - begin + 1)))
        return total

    back = back_in_quads if quads else back_in_faces

    @wp.func
    def areas_adjoint(
        t: Tables, points: Any, params: Any, point: wp.vec3, area_vector_bar: wp.vec3, area_vector_bars: Any
    ):
        return back(t.fans, points, area_vector_bars, params.number, point, area_vector_bar)

    return Adjoint(areas_adjoint, ("point",), of_eight=areas_of_eight() if quads else None)


@cache
def ring_area_adjoint(shear_begin: int, least_valence: int, at: Any) -> Adjoint:
    """Return the adjoint that gathers it around a particle whose springs are in slots, see `loops.slots.ring_area`.

    Args:
        shear_begin: slots of structural springs.
        least_valence: quads around each particle that there are at least.
    """

    @wp.func
    def areas_adjoint(points: Any, springs: Any, point: wp.vec3, area_vector_bar: wp.vec3, area_vector_bars: Any):
        total = wp.vec3()
        first = at(points, springs.neighbors[0]) - point
        first_bar = at(area_vector_bars, springs.neighbors[0]) - area_vector_bar
        before = first
        before_bar = first_bar
        for slot in range(1, shear_begin + 1):
            across = before + (at(points, springs.neighbors[shear_begin + slot - 1]) - point)
            across_bar = before_bar + (
                at(area_vector_bars, springs.neighbors[shear_begin + slot - 1]) - area_vector_bar
            )
            after = first
            after_bar = first_bar
            if slot < shear_begin:
                after = at(points, springs.neighbors[slot]) - point
                after_bar = at(area_vector_bars, springs.neighbors[slot]) - area_vector_bar
            end = after
            end_bar = after_bar
            if slot >= least_valence and slot < shear_begin:
                end = wp.where(slot == springs.valence, first, after)
                end_bar = wp.where(slot == springs.valence, first_bar, after_bar)
            total = plus_cross(plus_cross(total, end_bar - before_bar, across), end - before, across_bar)
            before = after
            before_bar = after_bar
        return CROSSES * total

    return Adjoint(areas_adjoint, ("point",))


def pull_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoints of the forces on a particle."""
    if look.world:
        return pull_of_eight(features, look.at)
    found = [_laws(features)] if features.of_kind("particle") else []
    if features.has("string"):
        found.append(string_adjoint(features))
    found.append(spring_adjoint(features, look.at, look.slots))
    if features.membranes:
        faces = None if features.viscous else look.membrane_faces(features)
        found.append(
            membrane_faces_adjoint(features, faces.layout, faces.keeps_places)
            if faces
            else membrane_adjoint(features, look.at)
        )
    if features.has("hinge"):
        found.append(hinge_adjoint(features, look.at))
    if features.measures_areas:
        ring = ring_area_adjoint(look.slots[0], look.ring, look.at) if look.slots and look.ring else None
        found.append(ring or area_adjoint(features.quads, look.at))
    return found


def _laws(features: Features) -> Adjoint:
    """Return the adjoint of the laws on a particle, which Warp derives."""
    laws = features.laws_added("particle")
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def work_of_laws(
        point: wp.vec3, velocity: wp.vec3, mass: float, share: float, area_vector: wp.vec3, up: wp.vec3,
        step_seconds: float, time: float, n: Any, bar: wp.vec3, water_load: wp.vec4,
    ):  # fmt: skip
        force = laws(wp.vec3(), point, velocity, mass, share, area_vector, water_load, up, step_seconds, time, n)
        return wp.dot(force, bar)

    @wp.func
    def laws_adjoint(
        t: Tables, params: Any, point: wp.vec3, velocity: wp.vec3, area_vector: wp.vec3, time: float, force_bar: wp.vec3
    ):
        by_point, by_velocity, by_mass, _share, by_area, _up, _step, _time, by_n, _bar, _load = wp.grad(work_of_laws)(
            point, velocity, params.mass, params.share, area_vector, t.up, t.step_seconds, time, params.n, force_bar,
            wp.vec4(),
        )  # fmt: skip
        params_bar = Params()
        params_bar.mass = by_mass
        params_bar.n = by_n
        return by_point, by_velocity, by_area, params_bar

    @wp.func
    def laws_adjoint_in_water(
        t: Tables, params: Any, point: wp.vec3, velocity: wp.vec3, area_vector: wp.vec3, water_load: wp.vec4,
        time: float, force_bar: wp.vec3,
    ):  # fmt: skip
        by_point, by_velocity, by_mass, _share, by_area, _up, _step, _time, by_n, _bar, by_load = wp.grad(
            work_of_laws
        )(
            point, velocity, params.mass, params.share, area_vector, t.up, t.step_seconds, time, params.n, force_bar,
            water_load,
        )  # fmt: skip
        params_bar = Params()
        params_bar.mass = by_mass
        params_bar.n = by_n
        return by_point, by_velocity, by_area, by_load, params_bar

    if features.in_water:
        return Adjoint(laws_adjoint_in_water, ("point", "velocity", "area_vector", "water_load", "params"))
    return Adjoint(laws_adjoint, ("point", "velocity", "area_vector", "params"))

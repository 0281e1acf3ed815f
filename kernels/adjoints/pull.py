"""Adjoints of the net force on a particle, on eight side by side, and of the push along normals.

Adjoints of forces on eight particles side by side, of eight worlds or of one: laws on particles, springs, areas. They
gather the same terms as those of one particle, see `adjoints.springs`, in the same order for eight worlds and for eight
particles of one, so that a world has the same derivatives in both to the bit.

Adjoint of the forces on faces, which their corners share: the air's lift and drag, and laws of one's own. A face's part
in the sum over all particles of force . bar is its force times the mean of its corners' bars. Warp derives that by the
face's center, area vector and velocity; each corner takes its own bar.

Adjoint of the load of a liquid on faces, which their corners share. A face's part in the sum over all particles of load
. bar is that of the triangles of its fan: the loads of their corners times those corners' bars, and the load of the
center times the mean of all corners' bars. Warp derives that by the triangle's corners and by the level; each corner of
the face takes its own bar.

Adjoint of area vectors: the second derivative of a closed balloon's volume, times a bar. An area vector a is the
gradient of the volume V, whose second derivative is symmetric. So the sum over all particles of a' . bar, derived by a
place x, is the derivative of x's own area vector along the bars: it is gathered around x, in the loop that finds a.
Bars count relative to that of x, as places do, since a common shift leaves a as it is.

Adjoints of the paper's push along normals: d = (A_near / A_total) N / |N|, N the sum of unit normals around. This push
is not conservative, so its derivative is no symmetric one: the transpose is gathered. Which face is nearest to a
particle is frozen. Of a particle's bar b by d comes

- by N: (A_near / A_total) (b - (b . n) n) / |N|, which each face around gets, and turns by its own unit normal
- by A_near, of the nearest face alone: b . n / A_total
- by A_total, summed over the balloon: -(A_near / A_total) (b . n) / A_total

and a face gives each of its corners, between those before and after, half of (after - before) x its bar.
"""

from collections.abc import Sequence
from functools import cache
from inspect import signature
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.adjoints.membranes import membrane_adjoint, membrane_faces_adjoint
from balloon_warp.kernels.adjoints.springs import KINDS, areas_of_eight, hinge_adjoint, spring_adjoint, string_adjoint
from balloon_warp.kernels.algebra import cross_product, dot_product, scaled, squared_length, times
from balloon_warp.kernels.compose import function_from, params_functions
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import LANE_COUNT, Five, Lanes, Lanes3, entry_at, number_in, of_lane, set_lane
from balloon_warp.kernels.laws.outer import FAR, NORMAL_FORCE, corner_load, normal_push, triangle_load
from balloon_warp.kernels.laws.springs import HOOKE
from balloon_warp.kernels.loops.areas import CROSSES, face_measures, plus_cross
from balloon_warp.kernels.memory import int_at, triple_at, vector_at
from balloon_warp.kernels.phase import Access, Adjoint, NoAdjointError, Phase, by_grad
from balloon_warp.kernels.tables import SLICE, FanTable, Tables, first_entry
from balloon_warp.kernels.working import Working


@wp.struct
class ParamsBar:
    """Derivatives by the mass of a particle in each lane."""

    mass: Lanes


def pull_of_eight(features: Features, at: Any) -> list[Adjoint]:
    """Return the adjoints of the forces on eight particles.

    Raises:
        NoAdjointError: something pulls that goes particle by particle.
    """
    others = ("string", "hinge", "face")
    if features.of_kind("spring") != (HOOKE,) or any(map(features.has, others)):
        raise NoAdjointError("forces that are not found for eight at a time")
    found = [laws_adjoint(features)] if features.of_kind("particle") else []
    found.append(spring_adjoint_of_eight(features, at))
    if features.measures_areas:
        found.append(area_adjoint_of_eight(features.quads, at))
    return found


@cache
def laws_adjoint(features: Features) -> Adjoint:
    """Return the adjoint of the laws on particles, which Warp derives for each lane by itself.

    Of the numbers that laws name it returns a row each, in the order of its columns.
    """
    laws, columns = features.laws_of_few("particle")
    Few = wp.types.vector(length=max(len(columns), 1), dtype=wp.float32)  # noqa: N806 - types
    FewLanes = wp.types.matrix(shape=(max(len(columns), 1), 8), dtype=wp.float32)  # noqa: N806

    @wp.func
    def laws_pairing(
        point: wp.vec3, velocity: wp.vec3, mass: float, share: float, area_vector: wp.vec3, up: wp.vec3,
        step_seconds: float, time: float, few: Few, bar: wp.vec3,
    ):  # fmt: skip
        force = laws(point, velocity, mass, share, area_vector, wp.vec4(), up, step_seconds, time, few)
        return wp.dot(force, bar)

    parts = ", ".join(f"number_in(numbers, {column}, lane)" for column in columns) or "0.0"
    text = f"def few_in_lane(numbers: Any, lane: wp.int32):\n    return Few({parts})\n"
    few_in_lane = function_from("few_in_lane", text, {"Few": Few, "number_in": number_in})

    @wp.func
    def laws_adjoint(
        t: Any, params: Any, numbers: Any, point: Any, velocity: Any, area_vector: Any, time: float, force_bar: Any
    ):
        point_bar = Lanes3()
        velocity_bar = Lanes3()
        area_bar = Lanes3()
        params_bar = ParamsBar()
        mass_bar = Lanes()
        few_bar = FewLanes()
        for lane in range(LANE_COUNT):
            by_point, by_velocity, by_mass, _share, by_area, _up, _step, _time, by_few, _bar = wp.grad(laws_pairing)(
                of_lane(point, lane), of_lane(velocity, lane), params.mass[lane], of_lane(params.share, lane),
                of_lane(area_vector, lane), t.up, t.step_seconds, time, few_in_lane(numbers, lane),
                of_lane(force_bar, lane),
            )  # fmt: skip
            point_bar = set_lane(point_bar, lane, by_point)
            velocity_bar = set_lane(velocity_bar, lane, by_velocity)
            area_bar = set_lane(area_bar, lane, by_area)
            mass_bar[lane] = by_mass
            for place in range(wp.static(len(columns))):
                few_bar[place, lane] = by_few[place]
        params_bar.mass = mass_bar
        return point_bar, velocity_bar, area_bar, params_bar, few_bar

    return Adjoint(laws_adjoint, ("point", "velocity", "area_vector", "params", "numbers"), columns=columns)


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight squared = *reinterpret_cast<const eight*>(&squares.c[0]);
    wp::vec_t<8, wp::float32> result;
    eight& inverse = *reinterpret_cast<eight*>(&result.c[0]);
    for (int k = 0; k < 8; ++k)
        inverse[k] = 1.0f / sqrtf(squared[k]);
    return result;
    """
)
def inverse_roots(squares: Lanes) -> Lanes:
    """Return 1 / sqrt in each lane."""
    ...


@wp.func_native(
    """
    #pragma clang fp contract(fast)
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight* const x = reinterpret_cast<const eight*>(&d.data[0][0]);
    const eight* const b = reinterpret_cast<const eight*>(&bar.data[0][0]);
    const eight p = *reinterpret_cast<const eight*>(&pull.c[0]);
    const eight t = *reinterpret_cast<const eight*>(&turned.c[0]);
    wp::mat_t<3, 8, wp::float32> result;
    eight* const r = reinterpret_cast<eight*>(&result.data[0][0]);
    const eight* const so_far = reinterpret_cast<const eight*>(&total.data[0][0]);
    for (int axis = 0; axis < 3; ++axis)
        r[axis] = so_far[axis] - p * b[axis] - t * x[axis];
    return result;
    """
)
def less_turned(total: Lanes3, d: Lanes3, bar: Lanes3, pull: Lanes, turned: Lanes) -> Lanes3:
    """Return a sum less a spring's term, as two fused instructions a component."""
    ...


@cache
def spring_adjoint_of_eight(features: Features, at: Any) -> Adjoint:
    """Return the adjoint of Hooke's springs around eight particles, see `springs.hooke_back`."""

    @wp.func
    def springs_adjoint(t: Any, points: Any, params: Any, numbers: Any, point: Any, force_bar: Any, force_bars: Any):
        point_bar = Lanes3()
        structural = Lanes()
        shear = Lanes()
        flexion = Lanes()
        for entry in range(t.spring_offsets[params.number], t.spring_offsets[params.number + 1]):
            end = entry_at(t.spring_ends, entry)
            length = entry_at(t.spring_lengths, entry)
            kind = entry_at(t.spring_kinds, entry)
            stiffness = entry_at(numbers, kind)
            if wp.static(features.springs_vary):
                stiffness = times(t.spring_scales[entry], stiffness)
            d = at(points, end) - point  # padding leads to the particle itself: no force, and no bar
            bar = force_bar - at(force_bars, end)
            inverse = inverse_roots(squared_length(d))
            along = dot_product(d, bar)
            stretched = times(length, inverse)
            product = times(stiffness, stretched)
            turned = times(times(product, times(inverse, inverse)), along)
            point_bar = less_turned(point_bar, d, bar, stiffness - product, turned)
            half = 0.5 * times(along, Lanes(1.0) - stretched)
            if wp.static(features.springs_vary):
                half = times(t.spring_scales[entry], half)
            structural += wp.where(kind == 0, half, Lanes())
            shear += wp.where(kind == 1, half, Lanes())
            flexion += wp.where(kind == 2, half, Lanes())
        return point_bar, structural, shear, flexion

    return Adjoint(springs_adjoint, ("point", *KINDS))


@cache
def area_adjoint_of_eight(quads: bool, at: Any) -> Adjoint:
    """Return the adjoint of the area vectors of eight particles, see `areas`."""

    @wp.func
    def back_in_quads(fans: Any, points: Any, bars: Any, number: wp.int32, point: Any, bar: Any):
        """Return the bars of the places of particles whose faces are all quads."""
        total = Lanes3()
        for entry in range(fans.offsets[number], fans.offsets[number + 1]):
            begin = int_at(fans.begins, entry)
            after = entry_at(fans.particles, begin)
            opposite = entry_at(fans.particles, begin + 1)
            before = entry_at(fans.particles, begin + 2)
            arm = at(points, before) - point
            arm_bar = at(bars, before) - bar
            total += cross_product(at(bars, after) - bar - arm_bar, arm + (at(points, opposite) - point))
            total += cross_product(at(points, after) - point - arm, arm_bar + (at(bars, opposite) - bar))
        return scaled(total, CROSSES)

    @wp.func
    def back_in_faces(fans: Any, points: Any, bars: Any, number: wp.int32, point: Any, bar: Any):
        """Return the bars of the places of particles with faces of any number of corners."""
        total = Lanes3()
        for corner in range(fans.offsets[number], fans.offsets[number + 1]):
            begin = int_at(fans.begins, corner)
            end = int_at(fans.begins, corner + 1)
            first = at(points, entry_at(fans.particles, begin)) - point
            first_bar = at(bars, entry_at(fans.particles, begin)) - bar
            arm = first
            arm_bar = first_bar
            arms = first
            arms_bar = first_bar
            double_area = Lanes3()
            for other in range(begin + 1, end):
                next_arm = at(points, entry_at(fans.particles, other)) - point
                next_bar = at(bars, entry_at(fans.particles, other)) - bar
                double_area += cross_product(arm_bar, next_arm) + cross_product(arm, next_bar)
                arms += next_arm
                arms_bar += next_bar
                arm = next_arm
                arm_bar = next_bar
            turned = cross_product(first_bar - arm_bar, arms) + cross_product(first - arm, arms_bar)
            total += scaled(double_area + turned, 0.5 / (3.0 * float(end - begin + 1)))
        return total

    back = back_in_quads if quads else back_in_faces

    @wp.func
    def areas_adjoint(t: Any, points: Any, params: Any, point: Any, area_vector_bar: Any, area_vector_bars: Any):
        return back(t.fans, points, area_vector_bars, params.number, point, area_vector_bar)

    return Adjoint(areas_adjoint, ("point",))


@wp.func
def added_adjoint(force_bar: wp.vec3):
    """Return the bar of a force to which another was added."""
    return force_bar


def add_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoint of an addition to a force: the bar before is the bar after."""

    return (Adjoint(added_adjoint, ("force",)),)


def add_face_forces_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoints of the forces on the faces around a particle."""
    laws, (center_of_face, area_vector_of_face) = features.laws_on("face"), face_measures(access.at)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type
    at, velocity_at, moving = access.at, access.velocity_at, features.needs("face", "velocity")

    @wp.func
    def face_pairing(
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
            by_center, by_area, by_velocity, _up, _step, _time, by_n, _bar = wp.grad(face_pairing)(
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

    return Adjoint(added_adjoint, ("force",)), Adjoint(faces_adjoint, ("point", "velocity", "params"))


@wp.func
def triangle_pairing(
    a: wp.vec3, b: wp.vec3, center: wp.vec3, level: float, up: wp.vec3, a_bar: wp.vec4, b_bar: wp.vec4,
    center_bar: wp.vec4,
):  # fmt: skip
    """Pairing of the loads on the corners of a fan's triangle with their bars."""
    load = triangle_load(a, b, center, level, up)
    return (
        wp.dot(corner_load(load, load.moments[0], load.areas[0]), a_bar)
        + wp.dot(corner_load(load, load.moments[1], load.areas[1]), b_bar)
        + wp.dot(corner_load(load, load.moments[2], load.areas[2]), center_bar)
    )


def find_water_load_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoint of the water load on the faces around a particle."""
    center_of_face, _ = face_measures(access.at)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type
    at, level = access.at, features.columns.places["water_level"]

    @wp.func
    def water_load_adjoint(t: Tables, points: Any, params: Any, water_load_bars: Any):
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
                by_p, by_q, by_center, by_level, _up, _p, _q, _center = wp.grad(triangle_pairing)(
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

    return (Adjoint(water_load_adjoint, ("point", "params")),)


@wp.func
def lift_adjoint(t: Tables, params: Any, upheld_bars: Any):
    """Return the sum of the bars of a balloon's particles."""
    total = Five()
    for particle in range(t.particles.offsets[params.balloon], t.particles.offsets[params.balloon + 1]):
        total += upheld_bars[particle]
    return total


def lift_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoint of a balloon's value that every particle reads: the sum of the particles' bars."""

    return (Adjoint(lift_adjoint, ("afloat",)),)


@cache
def area_adjoint(quads: bool, at: Any) -> Adjoint:
    """Adjoint of area vectors: gathers the bar of a particle's place."""

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

    return Adjoint(areas_adjoint, ("point",), of_eight=areas_of_eight if quads else None)


@cache
def ring_area_adjoint(shear_begin: int, min_valence: int, at: Any) -> Adjoint:
    """Return the adjoint that gathers it around a particle whose springs are in slots, see `loops.springs.ring_area`.

    Args:
        shear_begin: slots of structural springs.
        min_valence: quads around each particle that there are at least.
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
            if slot >= min_valence and slot < shear_begin:
                end = wp.where(slot == springs.valence, first, after)
                end_bar = wp.where(slot == springs.valence, first_bar, after_bar)
            total = plus_cross(plus_cross(total, end_bar - before_bar, across), end - before, across_bar)
            before = after
            before_bar = after_bar
        return CROSSES * total

    return Adjoint(areas_adjoint, ("point",))


def pull_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoints of the forces on a particle."""
    if access.world:
        return pull_of_eight(features, access.at)
    found = [_laws(features)] if features.of_kind("particle") else []
    if features.has("string"):
        found.append(string_adjoint(features))
    found.append(spring_adjoint(features, access.at, access.slots))
    if features.membranes:
        faces = None if features.viscous else access.membrane_faces(features)
        found.append(
            membrane_faces_adjoint(features, faces.layout, faces.keeps_places)
            if faces
            else membrane_adjoint(features, access.at)
        )
    if features.has("hinge"):
        found.append(hinge_adjoint(features, access.at))
    if features.measures_areas:
        ring = ring_area_adjoint(access.slots[0], access.ring, access.at) if access.slots and access.ring else None
        found.append(ring or area_adjoint(features.quads, access.at))
    return found


def _laws(features: Features) -> Adjoint:
    """Return the adjoint of the laws on a particle, which Warp derives."""
    laws = features.laws_added("particle")
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def laws_pairing(
        point: wp.vec3, velocity: wp.vec3, mass: float, share: float, area_vector: wp.vec3, up: wp.vec3,
        step_seconds: float, time: float, n: Any, bar: wp.vec3, water_load: wp.vec4,
    ):  # fmt: skip
        force = laws(wp.vec3(), point, velocity, mass, share, area_vector, water_load, up, step_seconds, time, n)
        return wp.dot(force, bar)

    @wp.func
    def laws_adjoint(
        t: Tables, params: Any, point: wp.vec3, velocity: wp.vec3, area_vector: wp.vec3, time: float, force_bar: wp.vec3
    ):
        by_point, by_velocity, by_mass, _share, by_area, _up, _step, _time, by_n, _bar, _load = wp.grad(laws_pairing)(
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
            laws_pairing
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


@wp.struct
class DirectionBars:
    """Bars of directions on the way to faces, shape (W, P), and to balloons."""

    of_sums: wp.array2d[wp.vec3]
    """Bars of the sum of unit normals around"""
    of_areas: wp.array2d[float]
    """Bars of the area of the nearest face"""
    nearest: wp.array2d[wp.int32]
    """Nearest faces"""
    of_totals: wp.array2d[float]
    """Bars of the area of the balloon, from each particle"""
    totals: wp.array2d[float]
    """Bars of the area of each balloon, shape (W, B)"""


def directions_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Empty adjoint of the directions of normal forces: separate kernels run them backwards."""
    return ()


@wp.func
def add_direction_bar(working: Working, world: wp.int32, particle: wp.int32, bar: wp.vec3):
    """Add to the bar of a particle's direction."""
    working.direction_bars[world, particle] = working.direction_bars[world, particle] + bar


@wp.func
def push_along_adjoint(
    working: Working, world: wp.int32, particle: wp.int32, keyed: float, inflation_direction: wp.vec3,
    inflation_bar: wp.vec3,
):  # fmt: skip
    """Return the bar of k_normal, and add to that of the particle's direction."""
    add_direction_bar(working, world, particle, normal_push(keyed) * inflation_bar)
    return normal_push(wp.dot(inflation_direction, inflation_bar))


@wp.func
def push_either_way_adjoint(
    t: Tables, working: Working, params: Any, keyed: float, load: wp.vec2, point: wp.vec3,
    inflation_direction: wp.vec3, area_vector: wp.vec3, inflation_bar: wp.vec3,
):  # fmt: skip
    """Return the bars of what inflates a particle, be it a normal force or a pressure."""
    keyed_bar = float(0.0)
    load_bar = wp.vec2()
    point_bar = wp.vec3()
    area_bar = wp.vec3()
    if params.kind == NORMAL_FORCE:
        add_direction_bar(working, params.world, params.number, normal_push(keyed) * inflation_bar)
        keyed_bar = normal_push(wp.dot(inflation_direction, inflation_bar))
    else:
        height = wp.dot(point, t.up)
        by_push = wp.dot(area_vector, inflation_bar)
        load_bar = wp.vec2(by_push, by_push * height)
        point_bar = (by_push * load[1]) * t.up
        area_bar = (load[0] + load[1] * height) * inflation_bar
    return keyed_bar, load_bar, point_bar, area_bar


def inflate_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Return the adjoint of the force of the inflation; bars of directions are left in `working.direction_bars`."""
    if not features.inflation_directions:
        return by_grad(phase, features, access)

    if not features.pressures:
        return (Adjoint(push_along_adjoint, ("keyed",)),)
    return (Adjoint(push_either_way_adjoint, ("keyed", "load", "point", "area_vector")),)


def expect_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoint of the expected inflation, that of the inflation by another name."""
    if not features.inflation_directions:
        return by_grad(phase, features, access)
    (found,) = inflate_backwards(phase, features, access)
    names = [name.replace("inflation_bar", "expected_bar") for name in signature(found.function.func).parameters]
    source = (
        f"def expect_adjoint({', '.join(f'{name}: Any' for name in names)}):\n"
        f"    return inflation_adjoint({', '.join(names)})\n"
    )
    return (Adjoint(function_from("expect_adjoint", source, {"inflation_adjoint": found.function}), found.of),)


center_of_face, area_vector_of_face = face_measures(vector_at)


@wp.func
def area_of(t: Tables, points: wp.array[wp.vec3], face: wp.int32):
    """Return the area vector of a face [m^2]."""
    return area_vector_of_face(t.faces, points, face, center_of_face(t.faces, points, face))


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def hand_on_to_faces(
    t: Tables, working: Working, all_points: wp.array2d[wp.vec3], areas: wp.array2d[float], bars: DirectionBars
):
    """Backward pass of each particle's direction into the bars of its inputs; clears its bar."""
    world, particle = wp.tid()
    bar = working.direction_bars[world, particle]
    working.direction_bars[world, particle] = wp.vec3()
    points = all_points[world]
    normals = wp.vec3()
    squared_distance = float(FAR)
    nearest = wp.int32(-1)
    for incidence in range(t.faces.particle_offsets[particle], t.faces.particle_offsets[particle + 1]):
        face = t.faces.around_particles[incidence]
        normals += wp.normalize(area_of(t, points, face))
        squared = wp.length_sq(center_of_face(t.faces, points, face) - points[particle])
        if squared < squared_distance:
            squared_distance = squared
            nearest = face
    of_sum = wp.vec3()
    of_area = float(0.0)
    of_total = float(0.0)
    length = wp.length(normals)
    if length > 0.0 and nearest >= 0:
        normal = normals / length
        total = areas[world, t.particles.balloon[particle]]
        part = wp.length(area_of(t, points, nearest)) / total
        along = wp.dot(bar, normal)
        of_sum = (part / length) * (bar - along * normal)
        of_area = along / total
        of_total = -part * of_area
    bars.of_sums[world, particle] = of_sum
    bars.of_areas[world, particle] = of_area
    bars.nearest[world, particle] = nearest
    bars.of_totals[world, particle] = of_total


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def add_up_totals(t: Tables, bars: DirectionBars):
    """Add up the bar of each balloon's area; a block a (world, balloon)."""
    world, balloon, thread = wp.tid()
    total = float(0.0)
    for particle in range(t.particles.offsets[balloon] + thread, t.particles.offsets[balloon + 1], wp.block_dim()):
        total += bars.of_totals[world, particle]
    found = wp.tile_sum(wp.tile(total))[0]
    if thread == 0:
        bars.totals[world, balloon] = found


@wp.func
def bar_of_face(t: Tables, bars: DirectionBars, world: wp.int32, face: wp.int32, area: wp.vec3, of_total: float):
    """Return the bar of a face's area vector."""
    size = wp.length(area)
    bar = wp.vec3()
    if size > 0.0:
        normal = area / size
        of_sums = wp.vec3()
        of_size = of_total
        for corner in range(t.faces.offsets[face], t.faces.offsets[face + 1]):
            other = t.faces.particles[corner]
            of_sums += bars.of_sums[world, other]
            if bars.nearest[world, other] == face:
                of_size += bars.of_areas[world, other]
        bar = (of_sums - wp.dot(of_sums, normal) * normal) / size + of_size * normal
    return bar


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def gather_from_faces(
    t: Tables, all_points: wp.array2d[wp.vec3], bars: DirectionBars, all_point_bar: wp.array2d[wp.vec3]
):
    """Add to the bar of each particle's place the terms of the faces around it; a thread a particle of each world."""
    world, particle = wp.tid()
    points = all_points[world]
    of_total = bars.totals[world, t.particles.balloon[particle]]
    total = wp.vec3()
    for incidence in range(t.faces.particle_offsets[particle], t.faces.particle_offsets[particle + 1]):
        face = t.faces.around_particles[incidence]
        bar = bar_of_face(t, bars, world, face, area_of(t, points, face), of_total)
        begin = t.faces.offsets[face]
        count = t.faces.offsets[face + 1] - begin
        for corner in range(count):
            if t.faces.particles[begin + corner] == particle:
                before = points[t.faces.particles[begin + (corner + count - 1) % count]]
                after = points[t.faces.particles[begin + (corner + 1) % count]]
                total += 0.5 * wp.cross(after - before, bar)
    all_point_bar[world, particle] = all_point_bar[world, particle] + total

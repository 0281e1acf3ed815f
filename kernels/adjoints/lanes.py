"""Adjoints of forces on eight particles side by side, of eight worlds or of one: laws on particles, springs, areas.

They gather the same terms as those of one particle, see `springs` and `areas`, in the same order for eight worlds and
for eight particles of one, so that a world has the same derivatives in both to the bit.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.springs import KINDS
from balloon_warp.kernels.algebra import cross_product, dot_product, scaled, squared_length, times
from balloon_warp.kernels.compose import function_from
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes3, entry_at, number_in, of_lane, set_lane
from balloon_warp.kernels.laws.springs import HOOKE
from balloon_warp.kernels.loops.areas import CROSSES
from balloon_warp.kernels.memory import int_at
from balloon_warp.kernels.phase import Adjoint, NoAdjointError


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
    def work_of_laws(
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
            by_point, by_velocity, by_mass, _share, by_area, _up, _step, _time, by_few, _bar = wp.grad(work_of_laws)(
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

"""Swelling of a balloon in a substep without its gas, from which the gas's pressure follows, see `laws.gas`."""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.derived import by_grad, by_grad_but
from balloon_warp.kernels.adjoints.solids import foresee_backwards
from balloon_warp.kernels.algebra import dot_product, reach_along, scaled, times
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.gas import (
    Swelling,
    free_along,
    memory_of_rate,
    rate_beside_obstacles,
    swelling_of_particle,
)
from balloon_warp.kernels.laws.inflation import NORMAL_FORCE
from balloon_warp.kernels.loops.near_solids import heads_for_solids
from balloon_warp.kernels.loops.obstacles import around_function, detour_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables


def _beside(features: Features) -> bool:
    return features.gas and features.obstacles


@phase("particle", {"course": wp.vec3}, when=_beside, light=True, adjoint=by_grad)
def head(features: Features, look: Look) -> Any:
    """Find a particle's velocity under the load of the previous substep [m/s]."""

    @wp.func
    def head(t: Any, load: Any, gain: Any, point: Any, free_velocity: Any, area_vector: Any):
        push = load[0] + times(load[1], reach_along(point, t.up))
        return free_velocity + scaled(area_vector, times(gain, push))

    return head


@phase(
    "particle", {"detour": wp.vec3, "away": wp.vec3}, when=_beside, light=True, rare=heads_for_solids,
    adjoint=foresee_backwards,
)  # fmt: skip
def foresee(features: Features, look: Look) -> Any:
    """Foresee the velocity change by obstacles [m/s], and the direction from the last one; zero if there is none."""
    detour_beside, around_particle = detour_function(features, look.sphere_at), around_function(features)

    @wp.func
    def foresee(t: Tables, spheres: Any, params: Any, end: float, gain: float, point: wp.vec3, course: wp.vec3):
        detour = wp.vec3()
        away = wp.vec3()
        if gain > 0.0:
            turned, normal = detour_beside(t, spheres, around_particle(params, end), point, course)
            detour = turned
            away = normal
        return detour, away

    @wp.func
    def foresee_solids(t: Tables, params: Any, end: float, gain: float, point: wp.vec3, course: wp.vec3):
        return foresee(t, t, params, end, gain, point, course)

    return foresee if features.spheres else foresee_solids


@phase("particle", {"swelling": Swelling}, when=lambda features: features.gas, sums=True, adjoint=by_grad_but("origin"))
def find_volume_rate(features: Features, look: Look) -> Any:
    """Sum the swelling of a balloon without its gas."""
    place = features.columns.places["breathing_damping"]

    @wp.func
    def without_memory(course: Any, params: Any, velocity: Any):
        """Take from a course the part of the velocity before the step that counts, where one breathes on."""
        if wp.static(features.breathes_on):
            return course - scaled(velocity, memory_of_rate(params.n[place]))
        else:
            return course

    @wp.func
    def of_kind(params: Any, swelling: Any):
        """Leave the swelling zero, where a normal force inflates."""
        if wp.static(features.inflation_directions):
            return wp.where(params.kind == NORMAL_FORCE, 0.0 * swelling, swelling)
        else:
            return swelling

    @wp.func
    def find_volume_rate(
        t: Any, params: Any, gain: Any, origin: Any, point: Any, velocity: Any, free_velocity: Any, area_vector: Any
    ):
        rate = dot_product(area_vector, without_memory(free_velocity, params, velocity))
        height = reach_along(point, t.up)
        return of_kind(
            params, swelling_of_particle(point - origin, area_vector, area_vector, rate, gain, params.share, height)
        )

    @wp.func
    def find_volume_rate_beside(
        t: Any, params: Any, gain: Any, load: Any, origin: Any, point: Any, velocity: Any, free_velocity: Any,
        area_vector: Any, detour: Any, away: Any,
    ):  # fmt: skip
        height = reach_along(point, t.up)
        free = free_along(area_vector, away)
        push = load[0] + times(load[1], height)
        moved = without_memory(free_velocity + detour, params, velocity)
        rate = rate_beside_obstacles(area_vector, free, moved, gain, push)
        return of_kind(
            params, swelling_of_particle(point - origin, area_vector, free, rate, gain, params.share, height)
        )

    return find_volume_rate_beside if features.obstacles else find_volume_rate

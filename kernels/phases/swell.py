"""Swelling of a balloon in a substep without its gas, from which the gas's pressure follows, see `laws.gas`."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.derived import by_grad, by_grad_but
from balloon_warp.kernels.adjoints.ground import foresee_backwards
from balloon_warp.kernels.algebra import dot_product, reach_along, scaled, times
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
from balloon_warp.kernels.traits import Traits


@cache
def memory_function(traits: Traits) -> Any:
    """Make the function that gives what of a velocity before the step counts in a balloon's swelling.

    It is a balloon's breathing_damping, where one breathes on.
    """

    @wp.func
    def remembered(velocity: wp.vec3, n: Any):
        if wp.static(traits.breathes_on):
            return memory_of_rate(n[wp.static(traits.columns.places["breathing_damping"])]) * velocity
        else:
            return wp.vec3()

    return remembered


def _beside(traits: Traits) -> bool:
    return traits.gas and traits.obstacles


@phase("particle", {"course": wp.vec3}, when=_beside, light=True, adjoint=by_grad)
def head(traits: Traits, look: Look) -> Any:
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
def foresee(traits: Traits, look: Look) -> Any:
    """Foresee the velocity change by obstacles [m/s], and the direction from the last one; zero if there is none."""
    detour_beside, around_own = detour_function(traits, look.sphere_at), around_function(traits)

    @wp.func
    def foresee(t: Tables, spheres: Any, own: Any, end: float, gain: float, point: wp.vec3, course: wp.vec3):
        detour = wp.vec3()
        away = wp.vec3()
        if gain > 0.0:
            turned, normal = detour_beside(t, spheres, around_own(own, end), point, course)
            detour = turned
            away = normal
        return detour, away

    @wp.func
    def foresee_solids(t: Tables, own: Any, end: float, gain: float, point: wp.vec3, course: wp.vec3):
        return foresee(t, t, own, end, gain, point, course)

    return foresee if traits.spheres else foresee_solids


@phase("particle", {"swelling": Swelling}, when=lambda traits: traits.gas, sums=True, adjoint=by_grad_but("origin"))
def swell(traits: Traits, look: Look) -> Any:
    """Sum the swelling of a balloon without its gas."""
    place = traits.columns.places["breathing_damping"]

    @wp.func
    def without_memory(course: Any, own: Any, velocity: Any):
        """Take from a course what of the velocity before the step counts, see `memory_function`."""
        if wp.static(traits.breathes_on):
            return course - scaled(velocity, memory_of_rate(own.n[place]))
        else:
            return course

    @wp.func
    def of_kind(own: Any, swelling: Any):
        """Leave the swelling zero, where a normal force inflates."""
        if wp.static(traits.aims):
            return wp.where(own.kind == NORMAL_FORCE, 0.0 * swelling, swelling)
        else:
            return swelling

    @wp.func
    def swell(
        t: Any, own: Any, gain: Any, origin: Any, point: Any, velocity: Any, free_velocity: Any, area_vector: Any
    ):
        rate = dot_product(area_vector, without_memory(free_velocity, own, velocity))
        height = reach_along(point, t.up)
        return of_kind(
            own, swelling_of_particle(point - origin, area_vector, area_vector, rate, gain, own.share, height)
        )

    @wp.func
    def swell_beside(
        t: Any, own: Any, gain: Any, load: Any, origin: Any, point: Any, velocity: Any, area_vector: Any, course: Any,
        detour: Any, away: Any,
    ):  # fmt: skip
        height = reach_along(point, t.up)
        free = free_along(area_vector, away)
        push = load[0] + times(load[1], height)
        rate = rate_beside_obstacles(area_vector, free, without_memory(course + detour, own, velocity), gain, push)
        return of_kind(own, swelling_of_particle(point - origin, area_vector, free, rate, gain, own.share, height))

    return swell_beside if traits.obstacles else swell

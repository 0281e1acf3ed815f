"""How a balloon would swell in a substep without its gas: by that the gas finds its pressure, see `laws.gas`."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.gas import (
    Swelling,
    free_along,
    memory_of_rate,
    rate_beside_obstacles,
    swelling_of_particle,
)
from balloon_warp.kernels.laws.inflation import NORMAL_FORCE
from balloon_warp.kernels.loops.obstacles import Around, around_function, course_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, WorldState
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


@cache
def swell_function(traits: Traits, sphere_at: Any) -> Any:
    """Make the function that gives a particle's part of its balloon's swelling."""
    course_beside_obstacles = course_function(traits, sphere_at)

    @wp.func
    def swell(
        t: Tables,
        spheres: Any,
        around: Around,
        share: float,
        gain: float,
        load: wp.vec2,
        arm: wp.vec3,
        point: wp.vec3,
        velocity: wp.vec3,
        remembered: wp.vec3,
        area_vector: wp.vec3,
    ):
        """Beside obstacles under the old load; the velocity is that without inflation.

        Args:
            gain: see `response`.
            arm: from a point of the balloon's own [m].
            remembered: what of the velocity before the step counts, see `memory_function`.
        """
        height = wp.dot(point, t.up)
        free = area_vector
        rate = float(0.0)
        if wp.static(traits.obstacles):
            push = load[0] + load[1] * height
            course = velocity + (gain * push) * area_vector
            if gain > 0.0:
                let, normal = course_beside_obstacles(t, spheres, around, point, course)
                course = let
                free = free_along(area_vector, normal)
            rate = rate_beside_obstacles(area_vector, free, course - remembered, gain, push)
        else:
            rate = wp.dot(area_vector, velocity - remembered)
        return swelling_of_particle(arm, area_vector, free, rate, gain, share, height)

    return swell


@phase("particle", {"swelling": Swelling}, when=lambda traits: traits.gas, sums=True)
def swell(traits: Traits, look: Look) -> Any:
    """Sum how the balloon would swell without its gas."""
    swelling_beside = swell_function(traits, look.sphere_at)
    remembered, around_own = memory_function(traits), around_function(traits)

    @wp.func
    def swell(
        t: Tables,
        state: WorldState,
        own: Any,
        end: float,
        gain: float,
        origin: wp.vec3,
        point: wp.vec3,
        velocity: wp.vec3,
        free_velocity: wp.vec3,
        area_vector: wp.vec3,
    ):
        """Under the load of the substep before."""
        if own.kind == NORMAL_FORCE:
            return Swelling()
        return swelling_beside(
            t, state, around_own(own, end), own.share, gain, state.inflation_loads[own.world, own.balloon],
            point - origin, point, free_velocity, remembered(velocity, own.n), area_vector,
        )  # fmt: skip

    return swell

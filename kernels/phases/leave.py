"""A particle leaves spheres, by the paper's rule, obstacles and the ground."""

from typing import Any

import warp as wp

from balloon_warp.kernels.contact.near import noting_function
from balloon_warp.kernels.fixed_point import add_quanta
from balloon_warp.kernels.loops.near_solids import near_solids
from balloon_warp.kernels.loops.obstacles import around_function, obstacle_loop
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.working import Working


@phase("particle", {"point": wp.vec3, "velocity": wp.vec3}, when=lambda traits: traits.obstacles, rare=near_solids)
def leave(traits: Traits, look: Look) -> Any:
    """Leave spheres, obstacles and the ground; what may exchange momentum with a sphere waits for the others."""
    leave_obstacles = obstacle_loop(traits, add_quanta)
    is_noted, around_own = noting_function(traits), around_function(traits)

    @wp.func
    def leave_all(
        t: Tables,
        state: WorldState,
        working: Working,
        own: Any,
        end: float,
        point: wp.vec3,
        velocity: wp.vec3,
        inflation: wp.vec3,
    ):
        if own.mass > 0.0:
            out, after = leave_obstacles(
                t, state, working.sphere_quanta, around_own(own, end), point, velocity, inflation
            )
            return out, after
        return point, velocity

    @wp.func
    def leave(t: Tables, state: WorldState, working: Working, own: Any, end: float, point: wp.vec3, velocity: wp.vec3):
        waits = own.mass <= 0.0
        if wp.static(traits.impulses):
            if not waits:
                waits = is_noted(t, state, working.near, own.world, own.number, point, velocity)
        if waits:
            return point, velocity
        out, after = leave_obstacles(t, state, working.sphere_quanta, around_own(own, end), point, velocity, wp.vec3())
        return out, after

    return leave_all if traits.penalties else leave

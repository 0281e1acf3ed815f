"""A particle leaves spheres, by the paper's rule, obstacles and the ground."""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.solids import leave_backwards
from balloon_warp.kernels.contact.near import noting_function
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.near_solids import near_solids
from balloon_warp.kernels.loops.obstacles import around_function, obstacle_loop, standing_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working


@phase(
    "particle", {"point": wp.vec3, "velocity": wp.vec3}, when=lambda features: features.obstacles, rare=near_solids,
    adjoint=leave_backwards,
)  # fmt: skip
def leave(features: Features, look: Look) -> Any:
    """Leave spheres, obstacles and the ground; one that may exchange momentum with a sphere waits for the others."""
    leave_obstacles = obstacle_loop(features, look.sphere_at)
    is_noted, around_particle = noting_function(features, look.sphere_at), around_function(features)
    stand = standing_function(features)

    @wp.func
    def leave_all(
        t: Tables,
        spheres: Any,
        params: Any,
        end: float,
        point: wp.vec3,
        velocity: wp.vec3,
        inflation: wp.vec3,
    ):
        if params.mass > 0.0:
            out, after = leave_obstacles(t, spheres, around_particle(params, end), point, velocity, inflation)
            return out, after
        return point, velocity

    @wp.func
    def leave_or_wait(
        t: Tables, spheres: Any, working: Working, params: Any, end: float, point: wp.vec3, velocity: wp.vec3
    ):
        if params.mass <= 0.0 or is_noted(t, spheres, working.near, params.world, params.number, point, velocity):
            return point, velocity
        out, after = leave_obstacles(t, spheres, around_particle(params, end), point, velocity, wp.vec3())
        return out, after

    @wp.func
    def leave_solids(t: Tables, params: Any, end: float, point: wp.vec3, velocity: wp.vec3):
        if params.mass <= 0.0:
            return point, velocity
        out, after = stand(t, around_particle(params, end), point, velocity)
        return out, after

    if features.penalties:
        return leave_all
    return leave_or_wait if features.impulses else leave_solids

"""A particle leaves spheres, by the paper's rule, obstacles and the ground."""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.ground import leave_backwards
from balloon_warp.kernels.contact.near import noting_function
from balloon_warp.kernels.fixed_point import add_quanta
from balloon_warp.kernels.loops.near_solids import near_solids
from balloon_warp.kernels.loops.obstacles import around_function, obstacle_loop, standing_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.working import Working


@wp.func
def add_penalty(spheres: Any, world: wp.int32, sphere: wp.int32, force: wp.vec3):
    """Add a force to those on a sphere [N], of any thread in any order."""
    add_quanta(spheres.sphere_quanta, world, sphere, force)


@phase(
    "particle", {"point": wp.vec3, "velocity": wp.vec3}, when=lambda traits: traits.obstacles, rare=near_solids,
    adjoint=leave_backwards,
)  # fmt: skip
def leave(traits: Traits, look: Look) -> Any:
    """Leave spheres, obstacles and the ground; what may exchange momentum with a sphere waits for the others."""
    leave_obstacles = obstacle_loop(traits, look.sphere_at, add_penalty)
    is_noted, around_own = noting_function(traits, look.sphere_at), around_function(traits)
    stand = standing_function(traits)

    @wp.func
    def leave_all(
        t: Tables,
        spheres: Any,
        own: Any,
        end: float,
        point: wp.vec3,
        velocity: wp.vec3,
        inflation: wp.vec3,
    ):
        if own.mass > 0.0:
            out, after = leave_obstacles(t, spheres, around_own(own, end), point, velocity, inflation)
            return out, after
        return point, velocity

    @wp.func
    def leave_or_wait(
        t: Tables, spheres: Any, working: Working, own: Any, end: float, point: wp.vec3, velocity: wp.vec3
    ):
        if own.mass <= 0.0 or is_noted(t, spheres, working.near, own.world, own.number, point, velocity):
            return point, velocity
        out, after = leave_obstacles(t, spheres, around_own(own, end), point, velocity, wp.vec3())
        return out, after

    @wp.func
    def leave_solids(t: Tables, own: Any, end: float, point: wp.vec3, velocity: wp.vec3):
        if own.mass <= 0.0:
            return point, velocity
        out, after = stand(t, around_own(own, end), point, velocity)
        return out, after

    if traits.penalties:
        return leave_all
    return leave_or_wait if traits.impulses else leave_solids

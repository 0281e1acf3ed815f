"""Spheres that meet spheres in a step, wherever they are kept: pair after pair, until nothing moves any more."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.collision import collision, mean_restitution, share_of
from balloon_warp.kernels.laws.contact import bounced
from balloon_warp.kernels.loops.rolling import leaving_function
from balloon_warp.kernels.tables import Tables, row_of_world, sphere_mass, sphere_radius, sphere_restitution
from balloon_warp.kernels.traits import Traits

MOST_SWEEPS = wp.constant(24)
"""over all pairs, in a step: a stack of two takes one or two, as a rule"""
SETTLED = wp.constant(1.0e-6)
"""of a radius: what moves by less is at rest"""


@wp.struct
class Paths:
    """Spheres that stand in arrays of the shape (world_count, sphere_count)."""

    starts: wp.array2d[wp.vec3]  # where they were before the step; empty where there are no two
    positions: wp.array2d[wp.vec3]
    velocities: wp.array2d[wp.vec3]


@wp.func
def paths_of(starts: wp.array2d[wp.vec3], positions: wp.array2d[wp.vec3], velocities: wp.array2d[wp.vec3]):
    paths = Paths()
    paths.starts = starts
    paths.positions = positions
    paths.velocities = velocities
    return paths


@wp.func
def path_in_arrays(t: Tables, paths: Paths, world: wp.int32, sphere: wp.int32):
    """Where a sphere was before the step, where it is after it, and its velocity."""
    return paths.starts[world, sphere], paths.positions[world, sphere], paths.velocities[world, sphere]


@wp.func
def put_in_arrays(t: Tables, paths: Paths, world: wp.int32, sphere: wp.int32, position: wp.vec3, velocity: wp.vec3):
    """A sphere's place and velocity after the step."""
    paths.positions[world, sphere] = position
    paths.velocities[world, sphere] = velocity


@cache
def colliding_function(traits: Traits, path_at: Any, put_sphere: Any) -> Any:
    """The function that lets the spheres of a world meet, once all have moved: by one thread, in the same order.

    Args:
        path_at: the function that gives a sphere's place before the step, its place after it, and its velocity.
        put_sphere: the function that gives it another place and velocity after the step.
    """
    leave_fixtures = leaving_function(traits) if traits.fixtures else None
    split = traits.columns.balloon_width
    gravity, height, ground_restitution = (
        traits.columns.places[name] - split for name in ("gravity", "ground_height", "ground_restitution")
    )

    @wp.func
    def put_beside(
        t: Tables, spheres: Any, world: wp.int32, time: float, sphere: wp.int32, position: wp.vec3, velocity: wp.vec3
    ):
        """A sphere that another has moved, out of the ground and obstacles."""
        radius = sphere_radius(t.spheres, world, sphere)
        if wp.static(traits.ground):
            row = row_of_world(world, t.world_numbers.shape[0])
            depth = t.world_numbers[row, height] + radius - wp.dot(position, t.up)
            if depth > 0.0:
                position += depth * t.up
                velocity = bounced(velocity, wp.vec3(), t.up, t.world_numbers[row, ground_restitution])
        if wp.static(traits.fixtures):
            start, _end, _motion = path_at(t, spheres, world, sphere)
            out, after = leave_fixtures(t, world, time, start, position, velocity, radius)
            position = out
            velocity = after
        put_sphere(t, spheres, world, sphere, position, velocity)

    @wp.func
    def meet_pair(t: Tables, spheres: Any, world: wp.int32, time: float, first: wp.int32, second: wp.int32):
        """Two spheres; whether that has moved them."""
        reach = sphere_radius(t.spheres, world, first) + sphere_radius(t.spheres, world, second)
        start, end, velocity = path_at(t, spheres, world, first)
        other_start, other_end, other_velocity = path_at(t, spheres, world, second)
        before = other_start - start
        shift, gain = collision(
            before, other_end - end - before, other_velocity - velocity, reach,
            mean_restitution(
                sphere_restitution(t.spheres, world, first), sphere_restitution(t.spheres, world, second)
            ),
            t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), gravity], t.up, t.step_seconds,
        )  # fmt: skip
        moved = wp.length(shift) + t.step_seconds * wp.length(gain) > SETTLED * reach
        if moved:
            mass = sphere_mass(t.spheres, world, first)
            other_mass = sphere_mass(t.spheres, world, second)
            own = share_of(mass, other_mass)
            others = share_of(other_mass, mass)
            put_beside(t, spheres, world, time, first, end - own * shift, velocity - own * gain)
            put_beside(t, spheres, world, time, second, other_end + others * shift, other_velocity + others * gain)
        return moved

    @wp.func
    def collide(t: Tables, spheres: Any, world: wp.int32, time: float):
        """At the end of a step [s]. A sphere without size is not there."""
        count = t.spheres.radius.shape[1]
        moving = bool(True)
        sweep = wp.int32(0)
        while moving and sweep < MOST_SWEEPS:
            moving = bool(False)
            for second in range(1, count):
                for first in range(second):
                    smallest = wp.min(sphere_radius(t.spheres, world, first), sphere_radius(t.spheres, world, second))
                    if smallest > 0.0:
                        moved = meet_pair(t, spheres, world, time, first, second)
                        moving = moving or moved
            sweep += 1

    return collide

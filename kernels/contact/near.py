"""Particles that may touch a sphere, marked by threads in any order: a mark for every few, and one for the world."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.spheres import is_near_sphere
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working

PARTICLES_A_MARK = wp.constant(8)


def mark_count(particle_count: int) -> int:
    """Return the number of marks of a world; the last is that of the world itself."""
    return -(-particle_count // PARTICLES_A_MARK) + 1


@wp.func
def are_noted(working: Working, world: wp.int32):
    """Return whether any particle of a world is."""
    return working.near[world, working.near.shape[1] - 1] > 0


@cache
def noting_function(features: Features, sphere_at: Any) -> Any:
    """Return the function that marks a particle."""
    spheres_there = features.spheres

    @wp.func
    def is_noted(
        t: Tables,
        spheres: Any,
        near: wp.array2d[wp.int32],
        world: wp.int32,
        particle: wp.int32,
        point: wp.vec3,
        velocity: wp.vec3,
    ):
        """Return whether a particle may touch a sphere, and mark it.

        All threads that write a mark write the same.
        """
        noted = bool(False)
        for sphere in range(spheres_there):
            center, motion, radius = sphere_at(t, spheres, world, sphere)
            noted = noted or is_near_sphere(t, center, motion, radius, point, velocity)
        if noted:
            near[world, particle // PARTICLES_A_MARK] = 1
            near[world, near.shape[1] - 1] = 1
        return noted

    return is_noted

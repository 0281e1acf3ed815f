"""Access of items to each other where the state is in arrays."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.net_force import Loops, scalar_loops
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.phase import Look
from balloon_warp.kernels.spheres import sphere_at
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working


@cache
def gathering_loops(features: Features) -> Loops:
    """Return loops over all forces on a particle."""
    return scalar_loops(features, vector_at)


@cache
def summed_loops(features: Features) -> Loops:
    """Return functions that read sums by other threads: forces of springs, strings, hinges, faces, and area vectors."""

    @wp.func
    def summed_force(
        t: Tables, points: Any, velocities: Any, params: Any, working: Working, point: Any, velocity: Any, time: float
    ):
        """Take the summed force [N], and clear it for the next substep."""
        force = working.forces[params.world, params.number]
        working.forces[params.world, params.number] = wp.vec3()
        return force

    @wp.func
    def summed_area_vector(t: Tables, points: Any, params: Any, working: Working, point: Any):
        """Take the summed area vector [m^2], and clear it."""
        area_vector = working.area_vectors[params.world, params.number]
        working.area_vectors[params.world, params.number] = wp.vec3()
        return area_vector

    return scalar_loops(features, vector_at, summed_force, summed_area_vector)._replace(others=None)


GATHERED = Look(vector_at, sphere_at, gathering_loops)
"""Access where each particle loops over its forces"""
SUMMED = Look(vector_at, sphere_at, summed_loops, alone=lambda features: not (features.in_water or features.bursts))
"""Access where other threads have summed the forces"""

"""How items see each other where their state stands in arrays."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.loops.net_force import Loops, scalar_loops
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.phase import Look
from balloon_warp.kernels.spheres import sphere_at
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.working import Working


@cache
def gathering_loops(traits: Traits) -> Loops:
    """Over all that acts on a particle."""
    return scalar_loops(traits, vector_at)


@cache
def summed_loops(traits: Traits) -> Loops:
    """What others have added up: forces of springs, strings, hinges and faces, and area vectors."""

    @wp.func
    def summed_force(
        t: Tables, points: Any, velocities: Any, own: Any, working: Working, point: Any, velocity: Any, time: float
    ):
        """[N]; nothing is left, so that the next substep adds up anew."""
        force = working.forces[own.world, own.number]
        working.forces[own.world, own.number] = wp.vec3()
        return force

    @wp.func
    def summed_area_vector(t: Tables, points: Any, own: Any, working: Working, point: Any):
        """[m^2]; nothing is left."""
        area_vector = working.area_vectors[own.world, own.number]
        working.area_vectors[own.world, own.number] = wp.vec3()
        return area_vector

    return scalar_loops(traits, vector_at, summed_force, summed_area_vector)._replace(others=None)


GATHERED = Look(vector_at, sphere_at, gathering_loops)
"""a particle goes through what acts on it"""
SUMMED = Look(vector_at, sphere_at, summed_loops, lambda traits: not (traits.in_water or traits.bursts))
"""others have added that up"""

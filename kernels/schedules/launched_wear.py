"""What becomes of membranes as they are stretched, as a kernel: a thread a triangle, before each substep's forces."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.loops.wear import wear_function
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.own import numbers_reader
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits


@cache
def wear_kernel(traits: Traits, keeps: bool = True) -> Any:
    """The kernel that finds what is left of the tension of triangles, and their stresses.

    Args:
        keeps: whether it notes the greatest energy densities in the state.
    """
    read_numbers = numbers_reader(traits.columns)
    wear = wear_function(traits, vector_at)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def wear_membranes(
        # model
        t: Tables,
        # state in
        points: wp.array2d[wp.vec3],
        # state in and out
        peaks: wp.array2d[float],
    ):
        """A thread a (world, triangle)."""
        world, triangle = wp.tid()
        n = read_numbers(t, world, t.particles.balloon[t.membranes.corners[triangle][0]])
        peak = float(0.0)
        if wp.static(traits.softens):
            peak = peaks[world, triangle]
        left, greatest, stress = wear(t, world, triangle, points[world], peak, n)
        t.membranes.wear.left[world, triangle] = left
        if wp.static(traits.softens and keeps):
            peaks[world, triangle] = greatest
        if wp.static(traits.bursts):
            t.membranes.wear.tears.stresses[world, triangle] = stress

    return wear_membranes

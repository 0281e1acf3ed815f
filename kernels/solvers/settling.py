"""Convergence of the projective solver: acceleration of its iterations, and their end.

An iteration of the solver is a step down g along A^-1 times its slope; A is at least the curvature of g. A motion
without stretch is only inertia to g, but springs as well to A: it takes some h^2 k / m iterations to settle. With the
momentum of Nesterov (1983) it takes the root of that: the next one begins beyond the end of this one, by its move times
n / (n + 3). n counts since the momentum was last dropped, which it is wherever it leads up (O'Donoghue and Candes
2015). The balloon's own momentum stays as it is.

A world has settled once an iteration changes little beside the effect of springs in the whole substep, both by the root
of their energies: |du|^2 = du A du, of the springs (u - w) (M + h C) (u - w). Where coordinates are large and springs
stiff, float32 resolves no more than that: then too, but not before `LEAST_OF_ROUNDED` iterations.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.tables import Tables

TOLERANCE = 2.0e-3
"""Tolerance: change of the last iteration over the change of springs in a substep"""
WORTH_SAYING = 1.0e-2
"""Tolerance above which a warning is given"""
LEAST_ITERATIONS, MOST_ITERATIONS = 10, 200
"""Range of the number of iterations in a substep, where the scene says "auto" """
LEAST_OF_ROUNDED = wp.constant(60)
"""Least number of iterations before a change below float32's resolution counts as none"""
RESOLUTION = wp.constant(3.0e-8)
"""Relative resolution of coordinates in float32: half of its epsilon, some 1.7 times the changes seen in balloons at
rest"""


@wp.struct
class Settling:
    """Convergence of each world in a substep, and its limits."""

    least: wp.int32
    """Least number of iterations"""
    most: wp.int32
    """Largest number of iterations"""
    tolerance: float
    worth_saying: float
    diagonals: wp.array2d[float]
    """Diagonals of the matrices A [kg], shape (matrix_count, particle_count)"""
    of_world: wp.array[wp.int32]
    """Matrix of each world, shape (world_count,)"""
    iterations: wp.array[wp.int32]
    """Number of iterations made, shape (world_count,), as the next two"""
    gathered: wp.array[wp.int32]
    """Number of iterations in which momentum was gathered"""
    going: wp.array[wp.int32]
    """Whether a world needs more iterations"""
    any_going: wp.array[wp.int32]
    """Whether any world needs more iterations, shape (1,)"""


@cache
def settling_kernel(features: Features, inertia: Any) -> Any:
    """Return the kernel that applies the global step, and tests for convergence.

    Args:
        features: of the model.
        inertia: see `projective.inertia_function`.
    """
    _, read_params = params_functions(features.columns, features.balloons)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def apply_increments(
        # model
        t: Tables,
        # state in
        frame: wp.array[wp.int32],
        points: wp.array2d[wp.vec3],
        # in
        free_displacements: wp.array2d[wp.vec3],
        residuals: wp.array2d[wp.vec3],
        increments: wp.array2d[wp.vec3],
        # in and out
        settling: Settling,
        displacements: wp.array2d[wp.vec3],
        reached: wp.array2d[wp.vec3],
        # out
        trial_points: wp.array2d[wp.vec3],
        unsettled: wp.array[wp.vec2],
    ):
        """Apply the increments of an iteration; a block a world, summed in an order that depends on no other world."""
        world, thread = wp.tid()
        if settling.going[world] == 0:
            return
        iterations = settling.iterations[world] + 1
        gathered = settling.gathered[world]
        matrix = settling.of_world[world]
        part = wp.vec4()
        for particle in range(thread, points.shape[1], wp.block_dim()):
            params = read_params(t, world, particle)
            if params.share > 0.0:
                increment = increments[world, particle]
                residual = residuals[world, particle]
                new = displacements[world, particle] + increment
                lag = new - free_displacements[world, particle]
                coarse = settling.diagonals[matrix, particle] * wp.length_sq(points[world, particle])
                part += wp.vec4(
                    wp.dot(residual, new - reached[world, particle]),
                    wp.dot(residual, increment),
                    inertia(params, t.step_seconds) * wp.length_sq(lag),
                    coarse,
                )
        sums = wp.tile_sum(wp.tile(part, preserve_type=True))[0]
        if sums[0] < 0.0:
            gathered = 0
        beyond = float(gathered) / float(gathered + 3)
        for particle in range(thread, points.shape[1], wp.block_dim()):
            new = displacements[world, particle] + increments[world, particle]
            onward = new + beyond * (new - reached[world, particle])
            reached[world, particle] = new
            displacements[world, particle] = onward
            trial_points[world, particle] = points[world, particle] + onward
        if thread == 0:
            squared = settling.tolerance * settling.tolerance
            rounded = sums[1] <= RESOLUTION * RESOLUTION * sums[3]
            settled = sums[1] <= squared * sums[2] or (rounded and iterations >= LEAST_OF_ROUNDED)
            ends = iterations >= settling.most or (settled and iterations >= settling.least)
            settling.iterations[world] = iterations
            settling.gathered[world] = gathered + 1
            settling.going[world] = wp.where(ends, 0, 1)
            if not ends:
                settling.any_going[0] = 1
            elif not rounded and sums[1] > settling.worth_saying * settling.worth_saying * sums[2]:
                change = wp.sqrt(sums[1] / wp.max(sums[2], 1.0e-30))
                before = unsettled[world]
                if before[0] == 0.0 or change > before[1]:
                    unsettled[world] = wp.vec2(float(frame[0] + 1), change)

    return apply_increments

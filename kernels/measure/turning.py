"""Kernels of how far each world's balloons have turned, by best fit, summed in a fixed order.

Each observes the worlds that a mask chooses; one without entries chooses all.
"""

import warp as wp

from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import is_chosen

wp.set_module_options(OPTIONS)


@wp.kernel
def sum_turning(
    mask: wp.array[wp.int32],
    # model
    balloon_particles: wp.array[wp.int32],
    rest_arms: wp.array[wp.vec3],
    # state in
    points: wp.array2d[wp.vec3],
    # out
    parts: wp.array3d[wp.mat33],
):
    """Sum products of places and arms from the center at rest; a thread a (world, balloon, thread)."""
    world, balloon, thread = wp.tid()
    if not is_chosen(mask, world):
        return
    total = wp.mat33()
    begin = balloon_particles[balloon]
    origin = points[world, begin]
    for particle in range(begin + thread, balloon_particles[balloon + 1], parts.shape[2]):
        total += wp.outer(points[world, particle] - origin, rest_arms[particle])
    parts[world, balloon, thread] = total


@wp.kernel
def join_turning(mask: wp.array[wp.int32], parts: wp.array3d[wp.mat33], turns: wp.array2d[wp.quat]):
    """Find the turns: the rotation of least squares (Kabsch); a thread a (world, balloon)."""
    world, balloon = wp.tid()
    if not is_chosen(mask, world):
        return
    total = wp.mat33()
    for thread in range(parts.shape[2]):
        total += parts[world, balloon, thread]
    left = wp.mat33()
    sizes = wp.vec3()
    right = wp.mat33()
    wp.svd3(total, left, sizes, right)
    mirrored = wp.determinant(left) * wp.determinant(right)
    upright = wp.diag(wp.vec3(1.0, 1.0, wp.sign(mirrored)))
    turn = wp.quat_from_matrix(left * upright * wp.transpose(right))
    turns[world, balloon] = wp.where(turn[3] < 0.0, -turn, turn)

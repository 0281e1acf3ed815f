"""Finds the state that has left the finite numbers."""

import warp as wp


@wp.kernel(enable_backward=False)
def find_non_finite(
    # state in
    points: wp.array2d[wp.vec3],
    # state out
    first_bad_particle: wp.array[wp.int32],
):
    """A thread a (world, particle): the lowest particle of each world whose position is not finite."""
    world, particle = wp.tid()
    if not wp.isfinite(points[world, particle]):
        wp.atomic_min(first_bad_particle, world, particle)

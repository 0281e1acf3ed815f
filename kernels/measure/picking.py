"""Picks worlds out of a batch."""

import warp as wp

from balloon_warp.kernels.options import OPTIONS

wp.set_module_options(OPTIONS)


@wp.kernel(enable_backward=False)
def pick_healthy_worlds(
    every: wp.array2d[wp.uint32], healthy: wp.array[wp.int32], chosen: wp.array[wp.int32], picked: wp.array2d[wp.uint32]
):
    """Copy a word of a chosen world, or keep the last good copy if it is not healthy; a thread a (world, word).

    Words of any array, and no generic kernel: Warp replays all forms of one in a graph of a CPU as the last that it
    recorded.
    """
    place, word = wp.tid()
    world = chosen[place]
    if healthy[world] == 1:
        picked[place, word] = every[world, word]


@wp.kernel(enable_backward=False)
def pick_torn_faces(
    torn: wp.array2d[float], healthy: wp.array[wp.int32], chosen: wp.array[wp.int32], picked: wp.array2d[wp.int8]
):
    """Copy 1 where a face of a chosen world is torn, as `pick_healthy_worlds` does; a thread a (world, face)."""
    place, face = wp.tid()
    world = chosen[place]
    if healthy[world] == 1:
        picked[place, face] = wp.where(torn[world, face] >= 0.0, wp.int8(1), wp.int8(0))

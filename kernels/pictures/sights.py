"""Sights of cameras that look into many worlds, and keys of a pixel's first hits: the depth, and the thing's number."""

import warp as wp

from balloon_warp.kernels.options import OPTIONS

wp.set_module_options(OPTIONS)


@wp.struct
class Sight:
    """A pinhole camera; `right` and `up` reach from the middle of the picture to its edges at depth one."""

    eye: wp.vec3
    forward: wp.vec3
    right: wp.vec3
    up: wp.vec3


@wp.func
def ray_of(sight: Sight, row: wp.int32, column: wp.int32, height: wp.int32, width: wp.int32):
    """Return the ray through the middle of a pixel, which reaches depth one."""
    x = 2.0 * (float(column) + 0.5) / float(width) - 1.0
    y = 1.0 - 2.0 * (float(row) + 0.5) / float(height)
    return sight.forward + x * sight.right + y * sight.up


@wp.func
def key_of(depth: float, number: wp.int32):
    """Return a number that is the less the nearer a thing is; floats above 0 are in order as integers, too."""
    return (wp.int64(wp.cast(depth, wp.int32)) << wp.int64(32)) + wp.int64(number)


@wp.func
def depth_of(key: wp.int64):
    """Return the depth in a key [m], infinite where nothing is seen."""
    return wp.cast(wp.int32(key >> wp.int64(32)), wp.float32)


@wp.func
def number_of(key: wp.int64):
    """Return the number of the thing in a key."""
    return wp.int32(key & wp.int64(0x7FFFFFFF))


@wp.kernel
def aim(
    eyes: wp.array[wp.vec3],
    targets: wp.array[wp.vec3],
    up: wp.vec3,
    half_width: float,
    half_height: float,
    # out
    sights: wp.array[Sight],
):
    """Turn cameras to their targets, with the up axis upwards in the picture; a thread a world."""
    world = wp.tid()
    sight = Sight()
    sight.eye = eyes[world]
    sight.forward = wp.normalize(targets[world] - eyes[world])
    across = wp.cross(sight.forward, up)
    if wp.length(across) < 1.0e-4:  # straight up or down
        across = wp.vec3(1.0, 0.0, 0.0)
    right = wp.normalize(across)
    sight.right = half_width * right
    sight.up = half_height * wp.cross(right, sight.forward)
    sights[world] = sight

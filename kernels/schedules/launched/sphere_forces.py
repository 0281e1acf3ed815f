"""Forces on spheres, where pieces of a substep are launches: as a frame begins, and as it ends."""

import warp as wp

from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.warps import set_quanta, total_newtons

wp.set_module_options(OPTIONS)


@wp.kernel
def read_sphere_forces(
    # state in
    sphere_forces: wp.array2d[wp.vec3],
    # out
    sphere_quanta: wp.array3d[wp.int64],
):
    """Convert sphere forces from newtons to whole numbers; a thread a (world, sphere)."""
    world, sphere = wp.tid()
    set_quanta(sphere_quanta, world, sphere, sphere_forces[world, sphere])


@wp.kernel
def write_sphere_forces(
    # in
    sphere_quanta: wp.array3d[wp.int64],
    # state out
    sphere_forces: wp.array2d[wp.vec3],
):
    """Convert sphere forces from whole numbers to newtons; a thread a (world, sphere)."""
    world, sphere = wp.tid()
    sphere_forces[world, sphere] = total_newtons(sphere_quanta, world, sphere)

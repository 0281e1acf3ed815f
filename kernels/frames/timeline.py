"""Times at which things start and end."""

import warp as wp

from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import row_of_world

wp.set_module_options(OPTIONS)


@wp.kernel(enable_backward=False)
def hold_spheres(
    # model
    first_frames: wp.array[wp.int32],
    initial_positions: wp.array2d[wp.vec3],
    initial_velocities: wp.array2d[wp.vec3],
    initial_spins: wp.array2d[wp.vec3],
    # state in
    frame: wp.array[wp.int32],
    # state out
    positions: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    spins: wp.array2d[wp.vec3],
):
    """Hold spheres at their place until their first frame, at the end of a frame; a thread a (world, sphere)."""
    world, sphere = wp.tid()
    if frame[row_of_world(world, frame.shape[0])] <= first_frames[sphere]:
        positions[world, sphere] = initial_positions[world % initial_positions.shape[0], sphere]
        velocities[world, sphere] = initial_velocities[world % initial_velocities.shape[0], sphere]
        spins[world, sphere] = initial_spins[world % initial_spins.shape[0], sphere]

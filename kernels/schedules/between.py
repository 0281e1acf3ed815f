"""What comes between the pieces of a substep, where each is a launch: springs are corrected, forces read and shown."""

import warp as wp

from balloon_warp.kernels.laws.correction import excess, moves_of_ends
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.schedules.fixed_point import set_quanta, total_newtons
from balloon_warp.kernels.tables import Tables, row_of_world

wp.set_module_options({**OPTIONS, "enable_backward": False})


@wp.kernel
def correct_color(
    # model
    t: Tables,
    limit_column: wp.int32,
    first_spring: wp.int32,
    # state in and out
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
):
    """A thread a (world, spring) of one color: shortened if it is too long."""
    world, number = wp.tid()
    spring = first_spring + number
    p = t.correction.particles[spring][0]
    q = t.correction.particles[spring][1]
    limit = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), limit_column]
    too_long = excess(points[world, q] - points[world, p], t.correction.rest_lengths[spring], limit)
    if wp.length_sq(too_long) > 0.0:
        move_p, move_q = moves_of_ends(t.particles.mass_share[p], t.particles.mass_share[q], too_long)
        points[world, p] = points[world, p] + move_p
        points[world, q] = points[world, q] + move_q
        velocities[world, p] = velocities[world, p] + move_p / t.step_seconds
        velocities[world, q] = velocities[world, q] + move_q / t.step_seconds


@wp.kernel
def read_sphere_forces(
    # state in
    sphere_forces: wp.array2d[wp.vec3],
    # out
    sphere_quanta: wp.array3d[wp.int64],
):
    """A thread a (world, sphere): from newtons to whole numbers."""
    world, sphere = wp.tid()
    set_quanta(sphere_quanta, world, sphere, sphere_forces[world, sphere])


@wp.kernel
def write_sphere_forces(
    # in
    sphere_quanta: wp.array3d[wp.int64],
    # state out
    sphere_forces: wp.array2d[wp.vec3],
):
    """A thread a (world, sphere): from whole numbers to newtons."""
    world, sphere = wp.tid()
    sphere_forces[world, sphere] = total_newtons(sphere_quanta, world, sphere)

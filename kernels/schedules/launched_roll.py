"""Spheres that move, where each piece of a substep is a launch."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.loops.colliding import colliding_function, path_in_arrays, paths_of, put_in_arrays
from balloon_warp.kernels.loops.rolling import course_of, rolling_function
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.schedules.fixed_point import set_quanta, total_newtons
from balloon_warp.kernels.substep import end_of_step
from balloon_warp.kernels.tables import Tables, row_of_world, sphere_mass
from balloon_warp.kernels.traits import Traits


@cache
def roll_kernel(traits: Traits) -> Any:
    """The kernel that moves spheres: under the forces since the last substep, which are then cleared, or, where they
    exchange momentum afterwards, without contact."""
    roll = rolling_function(traits)
    split = traits.columns.balloon_width
    gravity, height, restitution = (
        traits.columns.places[name] - split for name in ("gravity", "ground_height", "ground_restitution")
    )

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def roll_spheres(
        # model
        t: Tables,
        time_in_frame: float,
        frame: wp.array[wp.int32],
        # state in and out
        sphere_positions: wp.array2d[wp.vec3],
        sphere_velocities: wp.array2d[wp.vec3],
        sphere_spins: wp.array2d[wp.vec3],
        sphere_forces: wp.array2d[wp.vec3],
        sphere_quanta: wp.array3d[wp.int64],
        # out
        sphere_starts: wp.array2d[wp.vec3],
    ):
        """A thread a (world, sphere): one substep."""
        world, sphere = wp.tid()
        row = row_of_world(world, t.world_numbers.shape[0])
        around = wp.vec3(t.world_numbers[row, gravity], t.world_numbers[row, height], t.world_numbers[row, restitution])
        pushed = wp.vec3()
        if wp.static(traits.penalties):
            pushed = total_newtons(sphere_quanta, world, sphere) / sphere_mass(t.spheres, world, sphere)
            set_quanta(sphere_quanta, world, sphere, wp.vec3())
        else:
            sphere_forces[world, sphere] = wp.vec3()
        if wp.static(traits.keeps_starts):
            sphere_starts[world, sphere] = sphere_positions[world, sphere]
        before = course_of(
            sphere_positions[world, sphere], sphere_velocities[world, sphere], sphere_spins[world, sphere]
        )
        course = roll(t, world, sphere, end_of_step(t, frame, time_in_frame), before, pushed, around)
        sphere_positions[world, sphere] = course.position
        sphere_velocities[world, sphere] = course.velocity
        if wp.static(traits.spheres_rub):
            sphere_spins[world, sphere] = course.spin

    return roll_spheres


@cache
def collide_kernel(traits: Traits) -> Any:
    """The kernel by which spheres that have moved meet each other."""
    collide = colliding_function(traits, path_in_arrays, put_in_arrays)[0]

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def collide_spheres(
        # model
        t: Tables,
        time_in_frame: float,
        frame: wp.array[wp.int32],
        # in
        sphere_starts: wp.array2d[wp.vec3],
        # state in and out
        sphere_positions: wp.array2d[wp.vec3],
        sphere_velocities: wp.array2d[wp.vec3],
        sphere_spins: wp.array2d[wp.vec3],
    ):
        """A thread a world."""
        world = wp.tid()
        paths = paths_of(sphere_starts, sphere_positions, sphere_velocities)
        collide(t, paths, sphere_spins, world, end_of_step(t, frame, time_in_frame))

    return collide_spheres

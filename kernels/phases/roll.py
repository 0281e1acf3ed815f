"""Spheres move, and meet each other; then free bodies do."""

from typing import Any

import warp as wp

from balloon_warp.kernels.fixed_point import set_quanta, total_newtons
from balloon_warp.kernels.loops.colliding import colliding_function, path_in_arrays, paths_of, put_in_arrays
from balloon_warp.kernels.loops.rolling import course_of, rolling_function
from balloon_warp.kernels.loops.tumbling import tumbling_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, row_of_world, sphere_mass
from balloon_warp.kernels.traits import Traits


@phase("sphere", when=lambda traits: traits.spheres > 0)
def roll(traits: Traits, look: Look) -> Any:
    """Move a sphere, under the forces since the last substep, or where spheres exchange momentum without contact."""
    course_after = rolling_function(traits)
    split = traits.columns.balloon_width
    gravity, height, restitution = (
        traits.columns.places[name] - split for name in ("gravity", "ground_height", "ground_restitution")
    )

    @wp.func
    def roll(t: Tables, spheres: Any, world: wp.int32, sphere: wp.int32, end: float):
        numbers = t.world_numbers[row_of_world(world, t.world_numbers.shape[0])]
        around = wp.vec3(numbers[gravity], numbers[height], numbers[restitution])
        pushed = wp.vec3()
        if wp.static(traits.penalties):
            pushed = total_newtons(spheres.sphere_quanta, world, sphere) / sphere_mass(t.spheres, world, sphere)
            set_quanta(spheres.sphere_quanta, world, sphere, wp.vec3())
        else:
            spheres.sphere_forces[world, sphere] = wp.vec3()
        start = spheres.sphere_positions[world, sphere]
        if wp.static(traits.keeps_starts):
            spheres.sphere_starts[world, sphere] = start
        before = course_of(start, spheres.sphere_velocities[world, sphere], spheres.sphere_spins[world, sphere])
        course = course_after(t, world, sphere, end, before, pushed, around)
        spheres.sphere_positions[world, sphere] = course.position
        spheres.sphere_velocities[world, sphere] = course.velocity
        if wp.static(traits.spheres_rub):
            spheres.sphere_spins[world, sphere] = course.spin

    return roll


def may_collide(traits: Traits) -> Any:
    """Make the function that tells whether any of a thread's pairs of spheres may meet."""
    may_meet = colliding_function(traits, path_in_arrays, put_in_arrays)[1]

    @wp.func
    def may_any_meet(t: Tables, spheres: Any, world: wp.int32, thread: wp.int32):
        paths = paths_of(spheres.sphere_starts, spheres.sphere_positions, spheres.sphere_velocities)
        count = t.spheres.numbers.shape[1]
        near = bool(False)
        for pair in range(thread, count * count, wp.block_dim()):
            if pair // count < pair % count:
                near = near or may_meet(t, paths, world, pair // count, pair % count)
        return near

    return may_any_meet


@phase("world", when=lambda traits: traits.spheres_meet, due=may_collide)
def collide(traits: Traits, look: Look) -> Any:
    """Resolve collisions of spheres that have moved."""
    collide_all = colliding_function(traits, path_in_arrays, put_in_arrays)[0]

    @wp.func
    def collide(t: Tables, spheres: Any, world: wp.int32, end: float):
        paths = paths_of(spheres.sphere_starts, spheres.sphere_positions, spheres.sphere_velocities)
        collide_all(t, paths, spheres.sphere_spins, world, end)

    return collide


@phase("world", when=lambda traits: traits.bodies > 0)
def tumble(traits: Traits, look: Look) -> Any:
    """Move free bodies, once spheres have."""
    return tumbling_function(traits)

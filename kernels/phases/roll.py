"""Spheres move, and meet each other; then free bodies do."""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.rolling import roll_backwards
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.fixed_point import set_quanta, total_newtons
from balloon_warp.kernels.loops.bodies import body_mass
from balloon_warp.kernels.loops.colliding import colliding_function, may_meet
from balloon_warp.kernels.loops.rolling import course_at, put_course, rolling_function
from balloon_warp.kernels.loops.tumbling import tumbling_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world, sphere_mass, sphere_radius
from balloon_warp.kernels.working import Working


@phase("sphere", when=lambda features: features.spheres > 0, adjoint=roll_backwards)
def roll(features: Features, look: Look) -> Any:
    """Move a sphere, under the forces since the last substep, or where spheres exchange momentum without contact."""
    course_after = rolling_function(features)
    split = features.columns.balloon_width
    gravity, height, restitution = (
        features.columns.places[name] - split for name in ("gravity", "ground_height", "ground_restitution")
    )

    @wp.func
    def roll(t: Tables, spheres: Any, world: wp.int32, sphere: wp.int32, end: float):
        numbers = t.world_numbers[row_of_world(world, t.world_numbers.shape[0])]
        around = wp.vec3(numbers[gravity], numbers[height], numbers[restitution])
        pushed = wp.vec3()
        if wp.static(features.penalties):
            pushed = total_newtons(spheres.sphere_quanta, world, sphere) / sphere_mass(t.spheres, world, sphere)
            set_quanta(spheres.sphere_quanta, world, sphere, wp.vec3())
        else:
            spheres.sphere_forces[world, sphere] = wp.vec3()
        before = course_at(spheres, world, sphere)
        if wp.static(features.keeps_starts):
            spheres.sphere_starts[world, sphere] = before.position
        course = course_after(t, spheres, world, sphere, end, before, pushed, around)
        put_course(spheres, world, sphere, course, wp.static(features.spheres_rub))

    return roll


@phase("sphere", when=lambda features: features.spheres_shoved)
def shove(features: Features, look: Look) -> Any:
    """Push a sphere by the forces of the substep, before it exchanges momentum: so none is left as a frame ends."""

    @wp.func
    def shove(t: Tables, spheres: Any, world: wp.int32, sphere: wp.int32):
        push = total_newtons(spheres.sphere_quanta, world, sphere)
        set_quanta(spheres.sphere_quanta, world, sphere, wp.vec3())
        if sphere_radius(t.spheres, world, sphere) > 0.0:  # it is there
            gain = t.step_seconds / sphere_mass(t.spheres, world, sphere) * push
            spheres.sphere_velocities[world, sphere] = spheres.sphere_velocities[world, sphere] + gain

    return shove


@phase("world", when=lambda features: features.bodies_shoved)
def shove_bodies(features: Features, look: Look) -> Any:
    """Push free bodies by the forces and torques of the substep."""

    @wp.func
    def shove_bodies(t: Tables, state: WorldState, working: Working, world: wp.int32):
        for body in range(state.body_positions.shape[1]):
            push = t.step_seconds * total_newtons(working.body_quanta, world, body)
            twist = t.step_seconds * total_newtons(working.body_turning_quanta, world, body)
            set_quanta(working.body_quanta, world, body, wp.vec3())
            set_quanta(working.body_turning_quanta, world, body, wp.vec3())
            gain = push / body_mass(t, world, body)
            state.body_velocities[world, body] = state.body_velocities[world, body] + gain
            state.body_momenta[world, body] = state.body_momenta[world, body] + twist

    return shove_bodies


@wp.func
def may_any_meet(t: Tables, spheres: Any, world: wp.int32, thread: wp.int32):
    """Return whether any of a thread's pairs of spheres may meet."""
    count = t.spheres.numbers.shape[1]
    near = bool(False)
    for pair in range(thread, count * count, wp.block_dim()):
        if pair // count < pair % count:
            near = near or may_meet(t, spheres, world, pair // count, pair % count)
    return near


@phase("world", when=lambda features: features.spheres_meet, due=lambda features: may_any_meet, adjoint=roll_backwards)
def collide(features: Features, look: Look) -> Any:
    """Resolve collisions of spheres that have moved."""
    collide_all = colliding_function(features)

    @wp.func
    def collide(t: Tables, spheres: Any, world: wp.int32, end: float):
        collide_all(t, spheres, world, end)

    return collide


@phase("world", when=lambda features: features.bodies > 0)
def tumble(features: Features, look: Look) -> Any:
    """Move free bodies, once spheres have."""
    return tumbling_function(features)

"""Spheres in the resident kernel of the `block` schedule: each warp moves them for itself, alike.

What the warps tell each other stands on a board in shared memory: where the spheres are, and for each warp and sphere
the sum of the penalties of its particles, added in the same order every time. A substep reads one of two rows and
writes the other, so that it needs no barrier more; the stamp of a post is its substep, so that nothing is cleared.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact import move_sphere
from balloon_warp.kernels.health import HealthTable, look_at_sphere
from balloon_warp.kernels.tables import (
    BodyTable,
    ObstacleTable,
    WorldState,
    ground_height,
    ground_restitution,
    row_of_world,
)
from balloon_warp.kernels.warps import WARP_THREADS, shared_words, warp_sum_of_stamped, warp_sum_of_vectors

NEVER = wp.constant(-2)
"""a stamp that no substep has"""


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    float4 read = ((const float4*)board)[entry];
    return wp::vec4(read.x, read.y, read.z, read.w);
#else
    return wp::vec4();
#endif
    """
)
def read_entry(board: wp.uint64, entry: wp.int32) -> wp.vec4:
    """An entry of the board."""
    ...


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    ((float4*)board)[entry] = make_float4(v[0], v[1], v[2], fourth);
#endif
    """
)
def write_entry(board: wp.uint64, entry: wp.int32, v: wp.vec3, fourth: float):
    """A vector and a number into an entry of the board."""
    ...


@cache
def sphere_functions(threads: int, sphere_count: int) -> tuple[Any, ...]:
    """What a block of so many threads does with so many spheres.

    Entries of the board, of four words: two rows of posts, a post a warp and sphere, with the force and the stamp; two
    rows of centers and radii; two of velocities and inverse masses; and of each sphere the gravity, the ground's
    height and restitution, and its penalty.
    """
    warps = threads // int(WARP_THREADS)
    posts = 2 * warps * sphere_count
    motions = posts + 2 * sphere_count
    settings = motions + 2 * sphere_count
    entries = settings + sphere_count

    sphere_board = shared_words(4 * entries)

    @wp.func
    def post_of(substep: wp.int32, warp: wp.int32, sphere: wp.int32):
        return ((substep & 1) * sphere_count + sphere) * warps + warp

    @wp.func
    def place_of(substep: wp.int32, sphere: wp.int32):
        return posts + (substep & 1) * sphere_count + sphere

    @wp.func
    def motion_of(substep: wp.int32, sphere: wp.int32):
        return motions + (substep & 1) * sphere_count + sphere

    @wp.func
    def posted_force(board: wp.uint64, substep: wp.int32, sphere: wp.int32):
        """The penalties of a substep [N], by all threads of a warp."""
        posts_of_warps = board + wp.uint64(16) * wp.uint64(post_of(substep, 0, sphere))
        return warp_sum_of_stamped(posts_of_warps, warps, float(substep))

    @wp.func
    def begin_spheres(
        board: wp.uint64,
        bodies: BodyTable,
        obstacles: ObstacleTable,
        state: WorldState,
        world: wp.int32,
        lane: wp.int32,
    ):
        """What a frame begins with, by the first warp; the first post stands for the penalties since the last move."""
        if lane < WARP_THREADS:
            for post in range(lane, posts, WARP_THREADS):
                write_entry(board, post, wp.vec3(), float(NEVER))
            for sphere in range(sphere_count):
                radius = obstacles.sphere_radius[row_of_world(world, obstacles.sphere_radius.shape[0]), sphere]
                mass = obstacles.sphere_mass[row_of_world(world, obstacles.sphere_mass.shape[0]), sphere]
                penalty = obstacles.sphere_penalty[row_of_world(world, obstacles.sphere_penalty.shape[0]), sphere]
                if lane == post_of(-1, 0, sphere) % WARP_THREADS:  # the thread that has just written it
                    write_entry(board, post_of(-1, 0, sphere), state.sphere_forces[world, sphere], -1.0)
                if lane == 0:
                    write_entry(board, place_of(-1, sphere), state.sphere_positions[world, sphere], radius)
                    write_entry(board, motion_of(-1, sphere), state.sphere_velocities[world, sphere], 1.0 / mass)
                    gravity = bodies.gravity[row_of_world(world, bodies.gravity.shape[0])]
                    ground = wp.vec3(gravity, ground_height(obstacles, world), ground_restitution(obstacles, world))
                    write_entry(board, settings + sphere, ground, penalty)

    @wp.func
    def moved_sphere(
        board: wp.uint64,
        up: wp.vec3,
        sphere: wp.int32,
        substep: wp.int32,
        step_seconds: float,
        lane: wp.int32,
    ):
        """Center and velocity of a sphere in this substep, by each warp for itself; the first writes them down."""
        force = posted_force(board, substep - 1, sphere)
        place = read_entry(board, place_of(substep - 1, sphere))
        motion = read_entry(board, motion_of(substep - 1, sphere))
        setting = read_entry(board, settings + sphere)
        center, velocity = move_sphere(
            wp.vec3(place[0], place[1], place[2]), wp.vec3(motion[0], motion[1], motion[2]), motion[3] * force,
            place[3], setting[0], up, setting[1], setting[2], step_seconds,
        )  # fmt: skip
        if lane == 0:
            write_entry(board, place_of(substep, sphere), center, place[3])
            write_entry(board, motion_of(substep, sphere), velocity, motion[3])
        return center, velocity, place[3]

    @wp.func
    def sphere_now(board: wp.uint64, sphere: wp.int32, substep: wp.int32):
        """Center, velocity and radius of a sphere that has moved in this substep, after a barrier."""
        place = read_entry(board, place_of(substep, sphere))
        motion = read_entry(board, motion_of(substep, sphere))
        return wp.vec3(place[0], place[1], place[2]), wp.vec3(motion[0], motion[1], motion[2]), place[3]

    @wp.func
    def penalty_of(board: wp.uint64, sphere: wp.int32):
        return read_entry(board, settings + sphere)[3]

    @wp.func
    def post_force(board: wp.uint64, sphere: wp.int32, substep: wp.int32, lane: wp.int32, force: wp.vec3):
        """By all threads of a warp: what they add to the sphere's penalties."""
        total = warp_sum_of_vectors(force)
        if lane % WARP_THREADS == 0:
            write_entry(board, post_of(substep, lane // WARP_THREADS, sphere), total, float(substep))

    @wp.func
    def end_spheres(
        board: wp.uint64,
        health: HealthTable,
        state: WorldState,
        world: wp.int32,
        last_substep: wp.int32,
        lane: wp.int32,
    ):
        """The spheres into the state, and a look at them, by the first warp, after the last substep's barrier."""
        if lane < WARP_THREADS:
            for sphere in range(sphere_count):
                force = posted_force(board, last_substep, sphere)
                place = read_entry(board, place_of(last_substep, sphere))
                motion = read_entry(board, motion_of(last_substep, sphere))
                if lane == 0:
                    position = wp.vec3(place[0], place[1], place[2])
                    look_at_sphere(health, state.first_bad, world, state.points.shape[1], sphere, position)
                    state.sphere_positions[world, sphere] = position
                    state.sphere_velocities[world, sphere] = wp.vec3(motion[0], motion[1], motion[2])
                    state.sphere_forces[world, sphere] = force

    return sphere_board, begin_spheres, moved_sphere, sphere_now, penalty_of, post_force, end_spheres

"""Spheres in a thread block: on a board in shared memory.

On it stand where the spheres are, and for each warp and sphere the sum of what its particles push with, added in the
same order every time. A substep reads one of two rows and writes the other; the stamp of a post is its substep, so that
nothing is cleared.
"""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.loops.colliding import colliding_function
from balloon_warp.kernels.loops.rolling import course_of, rolling_function
from balloon_warp.kernels.measure.health import look_at_sphere
from balloon_warp.kernels.schedules.block.memory import Layout
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world, sphere_mass, sphere_radius
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import (
    WARP_THREADS,
    any_in_warp,
    block_barrier,
    read_entry,
    shared_words,
    warp_sum_of_stamped,
    warp_sum_of_vectors,
    write_entry,
)

NEVER = wp.constant(-2)
"""a stamp that no substep has"""


class Board(NamedTuple):
    """What a block does with its spheres."""

    begin: Any
    """(t, state, world, thread): what a frame begins with; a barrier must follow"""
    rolls_by_warps: bool
    """each warp moves the spheres for itself, when its particles leave them; otherwise `roll` comes before"""
    roll_sphere: Any
    """(t, spins, world, thread, substep, end, sphere): a sphere by a substep, by all threads of a warp, who learn where
    it is"""
    roll: Any
    """(t, spins, world, thread, substep, end): every sphere, a warp a sphere, and how they meet each other; a barrier
    must follow"""
    sphere_at: Any
    """(t, substep, world, sphere): center, velocity and radius of a sphere that has moved"""
    post: Any
    """(sphere, substep, thread, force): by all threads of a warp, what they push the sphere with"""
    put_sphere: Any
    """(substep, thread, sphere, center, velocity, radius, force): by the first thread, a sphere after it has met
    particles, and the force that this took"""
    show: Any
    """(t, state, starts, world, substep): by one thread, all spheres into the state, and where they were"""
    take: Any
    """(t, state, world, substep): by one thread, all spheres from there"""
    end: Any
    """(t, state, world, thread, last_substep): into the state, and a look at them"""


@cache
def board_of(traits: Traits, layout: Layout) -> Board:
    """For the warps of a block.

    Entries of the board, of four words: two rows of posts, a post a warp and sphere, with the force and the stamp; two
    rows of centers and radii; two of velocities and inverse masses; and of the world gravity, and the ground's height
    and restitution. Spins stay in the state: few have them.
    """
    count, warps = max(traits.spheres, 1), layout.warps
    rolls_by_warps = layout.resident and not traits.gas and not traits.spheres_meet and not traits.spheres_rub
    posts = 2 * warps * count
    motions = posts + 2 * count
    surroundings = motions + 2 * count
    board = shared_words("spheres", 4 * (surroundings + 1))
    split = traits.columns.balloon_width
    gravity, height, restitution = (
        traits.columns.places[name] - split for name in ("gravity", "ground_height", "ground_restitution")
    )
    roll_by_a_step = rolling_function(traits)

    @wp.func
    def post_of(substep: wp.int32, warp: wp.int32, sphere: wp.int32):
        return ((substep & 1) * count + sphere) * warps + warp

    @wp.func
    def place_of(substep: wp.int32, sphere: wp.int32):
        return posts + (substep & 1) * count + sphere

    @wp.func
    def motion_of(substep: wp.int32, sphere: wp.int32):
        return motions + (substep & 1) * count + sphere

    @wp.func
    def posted_force(substep: wp.int32, sphere: wp.int32):
        """What a sphere was pushed with in a substep [N], by all threads of a warp."""
        of_warps = board() + wp.uint64(16) * wp.uint64(post_of(substep, 0, sphere))
        return warp_sum_of_stamped(of_warps, warps, float(substep))

    @wp.func
    def begin(t: Tables, state: WorldState, world: wp.int32, thread: wp.int32):
        """By the first warp; the first post stands for the pushes since the last move."""
        writers = wp.min(WARP_THREADS, wp.block_dim())
        if thread < writers:
            for post in range(thread, posts, writers):
                write_entry(board(), post, wp.vec3(), float(NEVER))
            if thread == 0:
                row = row_of_world(world, t.world_numbers.shape[0])
                of_world = wp.vec3(
                    t.world_numbers[row, gravity], t.world_numbers[row, height], t.world_numbers[row, restitution]
                )
                write_entry(board(), surroundings, of_world, 0.0)
            for sphere in range(count):
                if thread == post_of(-1, 0, sphere) % writers:  # the thread that has just written it
                    write_entry(board(), post_of(-1, 0, sphere), state.sphere_forces[world, sphere], -1.0)
                if thread == 0:
                    radius = sphere_radius(t.spheres, world, sphere)
                    response = 1.0 / sphere_mass(t.spheres, world, sphere)
                    write_entry(board(), place_of(-1, sphere), state.sphere_positions[world, sphere], radius)
                    write_entry(board(), motion_of(-1, sphere), state.sphere_velocities[world, sphere], response)

    @wp.func
    def roll_sphere(
        t: Tables, spins: wp.array2d[wp.vec3], world: wp.int32, thread: wp.int32, substep: wp.int32, end: float,
        sphere: wp.int32,
    ):  # fmt: skip
        """By all threads of a warp; the substep ends at a time."""
        place = read_entry(board(), place_of(substep - 1, sphere))
        motion = read_entry(board(), motion_of(substep - 1, sphere))
        around = read_entry(board(), surroundings)
        before = course_of(wp.vec3(place[0], place[1], place[2]), wp.vec3(motion[0], motion[1], motion[2]), wp.vec3())
        if wp.static(traits.spheres_rub):
            before.spin = spins[world, sphere]
        pushed = wp.vec3()
        if wp.static(not traits.impulses):
            pushed = motion[3] * posted_force(substep - 1, sphere)
        course = roll_by_a_step(t, world, sphere, end, before, pushed, wp.vec3(around[0], around[1], around[2]))
        writes = thread % WARP_THREADS == 0
        if wp.static(rolls_by_warps):
            writes = thread == 0
        if writes:
            write_entry(board(), place_of(substep, sphere), course.position, place[3])
            write_entry(board(), motion_of(substep, sphere), course.velocity, motion[3])
            if wp.static(traits.spheres_rub):
                spins[world, sphere] = course.spin
        return course.position, course.velocity, place[3]

    @wp.func
    def path_at(t: Tables, substep: wp.int32, world: wp.int32, sphere: wp.int32):
        start = read_entry(board(), place_of(substep - 1, sphere))
        place = read_entry(board(), place_of(substep, sphere))
        motion = read_entry(board(), motion_of(substep, sphere))
        return (
            wp.vec3(start[0], start[1], start[2]),
            wp.vec3(place[0], place[1], place[2]),
            wp.vec3(motion[0], motion[1], motion[2]),
        )

    @wp.func
    def put_path(t: Tables, substep: wp.int32, world: wp.int32, sphere: wp.int32, position: wp.vec3, velocity: wp.vec3):
        place = read_entry(board(), place_of(substep, sphere))
        motion = read_entry(board(), motion_of(substep, sphere))
        write_entry(board(), place_of(substep, sphere), position, place[3])
        write_entry(board(), motion_of(substep, sphere), velocity, motion[3])

    collide, may_meet = colliding_function(traits, path_at, put_path) if traits.spheres_meet else (None, None)

    @wp.func
    def meet(t: Tables, spins: wp.array2d[wp.vec3], world: wp.int32, thread: wp.int32, substep: wp.int32, end: float):
        """By the first warp, which looks at all pairs; few are ever near."""
        near = bool(False)
        for pair in range(thread, count * count, wp.min(WARP_THREADS, wp.block_dim())):
            first = pair // count
            second = pair % count
            if first < second:
                near = near or may_meet(t, substep, world, first, second)
        if any_in_warp(near) and thread == 0:
            collide(t, substep, spins, world, end)

    @wp.func
    def roll(t: Tables, spins: wp.array2d[wp.vec3], world: wp.int32, thread: wp.int32, substep: wp.int32, end: float):
        for sphere in range(count):
            if thread // WARP_THREADS == sphere % warps:
                _center, _velocity, _radius = roll_sphere(t, spins, world, thread, substep, end, sphere)
        if wp.static(traits.spheres_meet):
            block_barrier()
            if thread < WARP_THREADS:
                meet(t, spins, world, thread, substep, end)

    @wp.func
    def sphere_at(t: Tables, substep: wp.int32, world: wp.int32, sphere: wp.int32):
        place = read_entry(board(), place_of(substep, sphere))
        motion = read_entry(board(), motion_of(substep, sphere))
        return wp.vec3(place[0], place[1], place[2]), wp.vec3(motion[0], motion[1], motion[2]), place[3]

    @wp.func
    def post(sphere: wp.int32, substep: wp.int32, thread: wp.int32, force: wp.vec3):
        """To what the warp has posted in this substep."""
        total = warp_sum_of_vectors(force)
        if thread % WARP_THREADS == 0:
            entry = post_of(substep, thread // WARP_THREADS, sphere)
            before = read_entry(board(), entry)
            if before[3] == float(substep):
                total += wp.vec3(before[0], before[1], before[2])
            write_entry(board(), entry, total, float(substep))

    @wp.func
    def put_sphere(
        substep: wp.int32,
        thread: wp.int32,
        sphere: wp.int32,
        center: wp.vec3,
        velocity: wp.vec3,
        radius: float,
        force: wp.vec3,
    ):
        if thread == 0:
            write_entry(board(), place_of(substep, sphere), center, radius)
            write_entry(board(), motion_of(substep, sphere), velocity, 0.0)  # nobody asks for its mass here
            write_entry(board(), post_of(substep, 0, sphere), force, float(substep))

    @wp.func
    def show(t: Tables, state: WorldState, starts: wp.array2d[wp.vec3], world: wp.int32, substep: wp.int32):
        for sphere in range(count):
            start, position, velocity = path_at(t, substep, world, sphere)
            starts[world, sphere] = start
            state.sphere_positions[world, sphere] = position
            state.sphere_velocities[world, sphere] = velocity

    @wp.func
    def take(t: Tables, state: WorldState, world: wp.int32, substep: wp.int32):
        for sphere in range(count):
            position = state.sphere_positions[world, sphere]
            put_path(t, substep, world, sphere, position, state.sphere_velocities[world, sphere])

    @wp.func
    def end(t: Tables, state: WorldState, world: wp.int32, thread: wp.int32, last_substep: wp.int32):
        """By the first warp, after the last substep's barrier."""
        if thread < WARP_THREADS:
            for sphere in range(count):
                force = posted_force(last_substep, sphere)
                center, velocity, _radius = sphere_at(t, last_substep, world, sphere)
                if thread == 0:
                    look_at_sphere(t.health, state.first_bad, world, state.points.shape[1], sphere, center)
                    state.sphere_positions[world, sphere] = center
                    state.sphere_velocities[world, sphere] = velocity
                    state.sphere_forces[world, sphere] = force

    return Board(begin, rolls_by_warps, roll_sphere, roll, sphere_at, post, put_sphere, show, take, end)

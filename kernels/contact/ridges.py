"""Contact of faces and edges of balloons with ridges of obstacles and free bodies, and with spheres, a block a world.

Each piece of a substep is a launch. Pairs that are near push each other apart, all at once, a few times a substep, see
`laws.ridges`.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.ridge_pairs import (
    bearing_function,
    catching_function,
    pushing_functions,
    sharing_functions,
)
from balloon_warp.kernels.contact.ridge_push import excess_of, missing_of, move_of, push_functions
from balloon_warp.kernels.contact.ridge_search import ridge_search_function
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import block_barrier
from balloon_warp.kernels.working import Working

MOST_SWEEPS = wp.constant(24)
"""Largest number of sweeps in a substep; it ends sooner where nothing comes too near"""
CAUGHT = wp.constant(1)
"""Index of the number of pairs that may touch in this substep, after the number of all that are near"""
SETTLED = wp.constant(0.02)
"""Fraction of the distance to ridges by which features may come nearer in a substep"""


@cache
def sweeping_functions(features: Features) -> tuple[Any, Any]:
    """Return the functions that find pairs that approach too fast, and that apply their impulses and friction."""
    beside, push_pair = pushing_functions(features)
    count_in, _ = sharing_functions(features)
    bearing_of, impulse_of = bearing_function(features), push_functions(features)[1]

    @wp.func
    def find_pushed(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, count: wp.int32,
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Return the largest excess approach speed of the pairs of a thread [m/s], and count these pairs."""
        worst = float(0.0)
        for pair in range(thread, count, wp.block_dim()):
            catch = working.catches[world, pair]
            excess = excess_of(catch, beside(t, state, working, world, catch, velocities), t.step_seconds)
            if excess > 0.0:
                count_in(t, working, world, catch)
                worst = wp.max(worst, excess)
            working.catches[world, pair].push = excess
        return worst

    @wp.func
    def push_apart(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, count: wp.int32,
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Apply impulses and friction of the pairs of a thread."""
        for pair in range(thread, count, wp.block_dim()):
            catch = working.catches[world, pair]
            if catch.push > 0.0:
                relative = wp.vec3()
                if catch.friction > 0.0:
                    relative = beside(t, state, working, world, catch, velocities)
                bearing = bearing_of(t, working, world, catch)
                push_pair(t, working, world, catch, impulse_of(catch, bearing, catch.push, relative))

    return find_pushed, push_apart


@cache
def parting_functions(features: Features) -> tuple[Any, Any, Any]:
    """Return functions that find pairs that are too near, that part them, and that apply the displacements."""
    _, push_pair = pushing_functions(features)
    count_in, move_by_impulses = sharing_functions(features)
    bearing_of, gain_along = bearing_function(features), push_functions(features)[0]

    @wp.func
    def find_overlaps(t: Tables, working: Working, world: wp.int32, thread: wp.int32, count: wp.int32):
        """Return the largest displacement that overlaps of a thread's pairs need [m], and count these pairs."""
        worst = float(0.0)
        for pair in range(thread, count, wp.block_dim()):
            catch = working.catches[world, pair]
            out = missing_of(catch)
            if out > 0.0:
                count_in(t, working, world, catch)
                worst = wp.max(worst, out)
            working.catches[world, pair].push = out
        return worst

    @wp.func
    def move_apart(t: Tables, working: Working, world: wp.int32, thread: wp.int32, count: wp.int32):
        for pair in range(thread, count, wp.block_dim()):
            catch = working.catches[world, pair]
            if catch.push > 0.0:
                along = gain_along(catch, bearing_of(t, working, world, catch), catch.normal)
                push_pair(t, working, world, catch, move_of(catch, along, catch.push))

    @wp.func
    def move_all(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, count: wp.int32,
        speeds: float, points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Move the particles, bodies and spheres of pairs that are a thread's, see `move_by_impulses`."""
        for pair in range(thread, count, wp.block_dim()):
            if working.catches[world, pair].push > 0.0:
                move_by_impulses(t, state, working, world, working.catches[world, pair], speeds, points, velocities)

    return find_overlaps, move_apart, move_all


@cache
def catching_all_function(features: Features) -> Any:
    """Return the function that lists the contacts of a substep."""
    search_ridges = ridge_search_function(features)
    catch_of = catching_function(features)

    @wp.func
    def catch_all(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """List pairs that may meet in a substep, by all threads of a block, in any order; return their number."""
        near, way = search_ridges(t, state, working, world, thread, end, points, velocities)
        if near == 0:
            return 0
        if thread == 0:
            working.ridge_counts[world, CAUGHT] = 0
        block_barrier()
        for pair in range(thread, near, wp.block_dim()):
            catch = catch_of(t, state, working, world, pair, end, points, velocities)
            if wp.length_sq(catch.normal) > 0.0 and catch.gap < catch.kept + way:
                working.catches[world, wp.atomic_add(working.ridge_counts, world, CAUGHT, 1)] = catch
        block_barrier()
        return working.ridge_counts[world, CAUGHT]

    return catch_all


@cache
def pushing_all_function(features: Features) -> Any:
    """Return the function of a sweep."""
    find_pushed, push_apart = sweeping_functions(features)
    move_all = parting_functions(features)[2]

    @wp.func
    def push_all(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, count: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Push apart all pairs that approach too fast, and return whether another sweep is needed."""
        mine = find_pushed(t, state, working, world, thread, count, velocities)
        worst = wp.tile_max(wp.tile(mine))[0]
        block_barrier()
        if worst > 0.0:
            push_apart(t, state, working, world, thread, count, velocities)
            block_barrier()
            move_all(t, state, working, world, thread, count, 1.0, points, velocities)
            block_barrier()
        return t.step_seconds * worst >= SETTLED * t.ridges.kept

    return push_all


@cache
def ridges_function(features: Features) -> Any:
    """Return the function that resolves contacts of faces with ridges, once all have moved."""
    catch_all, push_all = catching_all_function(features), pushing_all_function(features)
    find_overlaps, move_apart, move_all = parting_functions(features)

    @wp.func
    def leave_ridges(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Resolve contacts with ridges in a world, by all threads of a block; soon done where nothing is near."""
        count = catch_all(t, state, working, world, thread, end, points, velocities)
        if count > 0:
            sweep = wp.int32(0)
            while sweep < MOST_SWEEPS:
                sweep += 1
                if not push_all(t, state, working, world, thread, count, points, velocities):
                    sweep = MOST_SWEEPS
            mine = find_overlaps(t, working, world, thread, count)
            overlap = wp.tile_max(wp.tile(mine))[0]
            block_barrier()
            if overlap > 0.0:
                move_apart(t, working, world, thread, count)
                block_barrier()
                move_all(t, state, working, world, thread, count, 0.0, points, velocities)
                block_barrier()

    return leave_ridges

"""Contact of edges, a block a world.

Each piece of a substep is a launch. A search now and then finds edges that are near each other; these push each other
apart, all at once, a few times a substep: each of N contacts on a particle has an N-th of its mass (Tonge and others
2012, mass splitting).
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.catch import EdgeCatch
from balloon_warp.kernels.contact.edge_catch import (
    catching_functions,
    count_ends,
    excess_of,
    forget_stop,
    pushing_functions,
)
from balloon_warp.kernels.contact.search import TOUCHING
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.ridges import way_to_part
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import any_in_block, block_barrier
from balloon_warp.kernels.working import Working

PAIRS = wp.constant(2)
"""Index of the number of edge pairs, after the lengths of lists of particles"""
CAUGHT = wp.constant(3)
"""Index of the number of pairs that may touch in this substep"""
SEEKING, BOXED = wp.constant(4), wp.constant(5)
"""Indices of the number of edges that go through trees in a search, and of pairs of edges whose boxes meet"""
BESIDE = wp.constant(4)
"""Number of threads that share the triangles of a particle"""
MOST_SWEEPS = wp.constant(300)
"""Largest number of sweeps over all pairs in a substep; it ends sooner where none comes too near"""
RESTS, PUSHES, GOES_ON = wp.constant(0), wp.constant(1), wp.constant(2)
"""Finds of a thread among its pairs: none comes too near, some do, or some do so far that another sweep is needed"""
SETTLED = wp.constant(0.01)
"""Fraction of the distance that edges keep by which they may come nearer in a substep, left to the next one"""
SAFE = wp.constant(0.2)
"""Fraction of a small distance by which edges may come nearer"""


@wp.func
def overlaps(catch: EdgeCatch):
    """Return whether a pair has come so near that it is moved apart."""
    return way_to_part(catch.crossing.gap, catch.kept) > 0.0


@cache
def catching_all_function(features: Features) -> Any:
    """Return the function that lists the pairs of edges, and of particles and triangles, that may touch."""
    catch_of, catch_of_particle = catching_functions(features)

    @wp.func
    def put(working: Working, world: wp.int32, catch: EdgeCatch):
        """List a pair, and return whether it overlaps."""
        slot = wp.atomic_add(working.list_lengths, world, CAUGHT, 1)
        if slot < working.edge_catches.shape[1]:
            working.edge_catches[world, slot] = catch
        else:
            wp.atomic_add(working.overflow, world, 1)
        return overlaps(catch)

    @wp.func
    def catch_all(
        t: Tables, working: Working, world: wp.int32, thread: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """List pairs that may touch in this substep, by all threads of a block, in any order.

        Returns their number, and whether any overlap, so that they are moved apart.

        A thread takes single pairs: where all of an edge or a particle are one's, the others wait for the fullest.
        """
        overlap = bool(False)
        if thread == 0:
            working.list_lengths[world, CAUGHT] = 0
        block_barrier()
        count = wp.min(working.list_lengths[world, PAIRS], working.edge_pairs.shape[1])
        for place in range(thread, count, wp.block_dim()):
            pair = working.edge_pairs[world, place]
            catch, near = catch_of(t, world, pair[0], pair[1], points, velocities)
            if near:
                overlap = put(working, world, catch) or overlap
        for place in range(thread, working.list_lengths[world, TOUCHING] * BESIDE, wp.block_dim()):
            particle = working.particle_lists[world, TOUCHING, place // BESIDE]
            for at in range(place % BESIDE, working.candidate_counts[world, particle], BESIDE):
                candidate = working.candidates[world, particle, at]
                catch, near = catch_of_particle(t, world, particle, candidate, points, velocities)
                if near:
                    overlap = put(working, world, catch) or overlap
        any_overlap = any_in_block(overlap)
        return wp.min(working.list_lengths[world, CAUGHT], working.edge_catches.shape[1]), any_overlap

    return catch_all


@wp.func
def find_pushed(
    t: Tables, working: Working, world: wp.int32, thread: wp.int32, count: wp.int32, velocities: wp.array[wp.vec3]
):
    """Mark the pairs of a thread that come too near, and return what it finds: `RESTS`, `PUSHES` or `GOES_ON`."""
    found = wp.int32(RESTS)
    for place in range(thread, count, wp.block_dim()):
        catch = working.edge_catches[world, place]
        excess = excess_of(t, catch, velocities)
        working.edge_catches[world, place].pushed = wp.where(excess > 0.0, 1, 0)
        if excess > 0.0:
            count_ends(working, world, catch)
            least = wp.min(SETTLED * catch.kept, SAFE * catch.crossing.gap)
            found = wp.max(found, wp.where(t.step_seconds * excess > least, GOES_ON, PUSHES))
    return found


@wp.func
def find_overlaps(working: Working, world: wp.int32, thread: wp.int32, count: wp.int32):
    """Mark the pairs of a thread that overlap, and return whether any does."""
    overlap = bool(False)
    for place in range(thread, count, wp.block_dim()):
        catch = working.edge_catches[world, place]
        is_near = overlaps(catch)
        working.edge_catches[world, place].pushed = wp.where(is_near, 1, 0)
        if is_near:
            count_ends(working, world, catch)
            overlap = True
    return overlap


@cache
def pushing_all_function(features: Features, note: Any = forget_stop) -> Any:
    """Return the function that pushes marked pairs of edges apart.

    Args:
        note: function that keeps how the ground stops a particle.
    """
    push_pair, part_pair, move_ends = pushing_functions(features, note)

    @wp.func
    def push_all(
        t: Tables, working: Working, world: wp.int32, thread: wp.int32, count: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3], speeds: float, has_marked: bool,
    ):  # fmt: skip
        """Push all marked pairs apart, by all threads of a block.

        Args:
            has_marked: whether the thread has marked any of its pairs.
            speeds: 1, or 0 where they are moved without speed.
        """
        end = wp.where(has_marked, count, 0)
        for place in range(thread, end, wp.block_dim()):
            if working.edge_catches[world, place].pushed == 1:
                if speeds > 0.0:
                    push_pair(t, working, world, working.edge_catches[world, place], velocities)
                else:
                    part_pair(t, working, world, working.edge_catches[world, place])
        block_barrier()
        for place in range(thread, end, wp.block_dim()):
            if working.edge_catches[world, place].pushed == 1:
                move_ends(t, working, world, working.edge_catches[world, place], points, velocities, speeds)
        block_barrier()

    return push_all


@cache
def edges_function(features: Features) -> Any:
    """Return the function by which edges push each other apart, once all particles have moved."""
    catch_all, push_all = catching_all_function(features), pushing_all_function(features)

    @wp.func
    def meet_edges(
        t: Tables,
        state: WorldState,
        working: Working,
        world: wp.int32,
        thread: wp.int32,
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):
        """Resolve contacts of the edges of a world, by all threads of a block."""
        if working.list_lengths[world, PAIRS] > 0:
            count, overlap = catch_all(t, working, world, thread, points, velocities)
            sweep = wp.int32(0)
            while count > 0 and sweep < MOST_SWEEPS:
                sweep += 1
                found = find_pushed(t, working, world, thread, count, velocities)
                again = any_in_block(found == GOES_ON)
                push_all(t, working, world, thread, count, points, velocities, 1.0, found > RESTS)
                if not again:
                    sweep = MOST_SWEEPS
            if overlap:
                mine = find_overlaps(working, world, thread, count)
                block_barrier()
                push_all(t, working, world, thread, count, points, velocities, 0.0, mine)

    return meet_edges

"""Contact of edges, a block a world.

Each piece of a substep is a launch. A search now and then finds edges that are near each other; these push each other
apart, all at once, a few times a substep: each of N contacts on a particle has an N-th of its mass (Tonge and others
2012, mass splitting).
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.catch import EdgeCatch
from balloon_warp.kernels.contact.edge_catch import catching_function
from balloon_warp.kernels.contact.edge_push import count_ends, excess_of, forget_stop, pushing_functions
from balloon_warp.kernels.contact.list_lengths import CAUGHT, PAIRS, SUBSTEPS
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.ridges import way_to_part
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import any_in_block, any_in_warp, block_barrier
from balloon_warp.kernels.working import Working

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
def catching_all_function(features: Features, leaves_out: bool = True) -> Any:
    """Return the function that lists the pairs of edges, and of particles and triangles, that may touch.

    Args:
        leaves_out: Whether pairs are left out that cannot touch yet, by how near they were when last measured; of
            substeps that follow each other alone.
    """
    catch_of = catching_function(features)

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
    def next_due(working: Working, world: wp.int32, place: wp.int32, count: wp.int32, substep: wp.int32):
        """Return the place of the next pair of a thread that may touch in a substep, or one beyond the list."""
        if wp.static(leaves_out):
            while place < count and working.edge_pairs[world, place][2] > substep:
                place += wp.block_dim()
        return place

    @wp.func
    def catch_all(
        t: Tables, working: Working, world: wp.int32, thread: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """List pairs that may touch in this substep, by all threads of a block, in any order.

        Returns their number, and whether any overlap, so that they are moved apart.

        A thread takes single pairs: where all of an edge or a particle are one's, the others wait for the fullest.
        Each thread first goes on to its next pair that is due, so that those of a warp measure together.
        """
        overlap = bool(False)
        if thread == 0:
            working.list_lengths[world, CAUGHT] = 0
        block_barrier()
        substep = working.list_lengths[world, SUBSTEPS]
        count = wp.min(working.list_lengths[world, PAIRS], working.edge_pairs.shape[1])
        place = next_due(working, world, thread, count, substep)
        while any_in_warp(place < count):  # or each thread of a warp would measure by itself
            if place < count:
                pair = working.edge_pairs[world, place]
                catch, near, clear = catch_of(t, working, world, wp.vec2i(pair[0], pair[1]), points, velocities)
                if near:
                    overlap = put(working, world, catch) or overlap
                if wp.static(leaves_out):
                    working.edge_pairs[world, place] = wp.vec3i(pair[0], pair[1], substep + 1 + clear)
            place = next_due(working, world, place + wp.block_dim(), count, substep)
        any_overlap = any_in_block(overlap)
        if thread == 0:
            working.list_lengths[world, SUBSTEPS] = substep + 1
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

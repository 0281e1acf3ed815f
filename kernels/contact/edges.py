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
from balloon_warp.kernels.contact.list_lengths import CAUGHT, MARKED, PAIRS, SUBSTEPS
from balloon_warp.kernels.contact.room import OF_CATCHES, ask_for_room
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.ridges import way_to_part
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import any_in_block, any_in_warp, block_barrier, next_place
from balloon_warp.kernels.working import Working

MOST_SWEEPS = wp.constant(300)
"""Largest number of sweeps over all pairs in a substep; it ends sooner where none comes too near"""
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
            ask_for_room(working, world, OF_CATCHES, slot + 1, 1)
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
            working.list_lengths[world, MARKED] = 0
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
def mark(working: Working, world: wp.int32, place: wp.int32):
    """List a pair that comes too near, and count it among the contacts of its ends."""
    working.edge_catches[world, next_place(working.list_lengths, world, MARKED)].marked = place
    count_ends(working, world, working.edge_catches[world, place])


@wp.func
def mark_pushed(
    t: Tables, working: Working, world: wp.int32, thread: wp.int32, count: wp.int32, velocities: wp.array[wp.vec3]
):
    """Mark the pairs of a thread that come too near, and return whether any does so far that one more sweep follows."""
    goes_on = bool(False)
    for place in range(thread, count, wp.block_dim()):
        catch = working.edge_catches[world, place]
        excess = excess_of(t, catch, velocities)
        if excess > 0.0:
            mark(working, world, place)
            least = wp.min(SETTLED * catch.kept, SAFE * catch.crossing.gap)
            goes_on = goes_on or t.step_seconds * excess > least
    return goes_on


@wp.func
def mark_overlaps(working: Working, world: wp.int32, thread: wp.int32, count: wp.int32):
    """Mark the pairs of a thread that overlap."""
    for place in range(thread, count, wp.block_dim()):
        if overlaps(working.edge_catches[world, place]):
            mark(working, world, place)


@cache
def pushing_all_function(features: Features, note: Any = forget_stop) -> Any:
    """Return the function that pushes marked pairs of edges apart.

    Args:
        note: function that keeps how the ground stops a particle.
    """
    push_pair, part_pair, move_end = pushing_functions(features, note)

    @wp.func
    def push_all(
        t: Tables, working: Working, world: wp.int32, thread: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3], speeds: float,
    ):  # fmt: skip
        """Push all marked pairs apart, by all threads of a block, a thread a pair and then a thread an end.

        Args:
            speeds: 1, or 0 where they are moved without speed.
        """
        count = working.list_lengths[world, MARKED]
        for item in range(thread, count, wp.block_dim()):
            place = working.edge_catches[world, item].marked
            if speeds > 0.0:
                push_pair(t, working, world, working.edge_catches[world, place], velocities)
            else:
                part_pair(t, working, world, working.edge_catches[world, place])
        block_barrier()
        if thread == 0:
            working.list_lengths[world, MARKED] = 0
        for item in range(thread, 4 * count, wp.block_dim()):
            place = working.edge_catches[world, item // 4].marked
            particle = working.edge_catches[world, place].ends[item % 4]
            move_end(t, working, world, particle, points, velocities, speeds)
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
                goes_on = mark_pushed(t, working, world, thread, count, velocities)
                again = any_in_block(goes_on)
                push_all(t, working, world, thread, points, velocities, 1.0)
                if not again:
                    sweep = MOST_SWEEPS
            if overlap:
                mark_overlaps(working, world, thread, count)
                block_barrier()
                push_all(t, working, world, thread, points, velocities, 0.0)

    return meet_edges

"""Search for edges that may touch each other, every few substeps, by the boxes of parts, see `contact.parts`.

Threads go through the trees of balloons for edges, or compare those of two leaves of a balloon near each other, see
`contact.near_parts`. They list pairs whose boxes meet; others measure these, so that threads of a warp do the same.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.boxes import ALONE, ARE_NEAR, boxes_meet, has_strayed, is_searched, pad_function
from balloon_warp.kernels.contact.clearances import pad_with_lookout
from balloon_warp.kernels.contact.edges import clear_substeps
from balloon_warp.kernels.contact.list_lengths import BOXED, PAIRS, SEEKING
from balloon_warp.kernels.contact.parts import Swept, box_of_edge, box_of_part
from balloon_warp.kernels.contact.room import OF_PAIRS, ask_for_room
from balloon_warp.kernels.contact.triangles import are_neighbors
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.ridges import KEPT, crossing_of
from balloon_warp.kernels.loops.meeting import skin_functions
from balloon_warp.kernels.memory import four_ints_at, int_at, int_pair_at, vector_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.warps import next_place
from balloon_warp.kernels.working import Working

BOXED_OF_EDGE, SEEKING_OF_EDGE = 12, 2
"""Number of pairs whose boxes meet, and of trees gone through, that a world has room for, for each of its edges; a
thread that finds no room for the first measures by itself, and without room for the second all edges go through all
trees"""
FIND_EDGES_REGISTERS = 64
"""Registers of a searching thread, so that more threads overlap their memory latencies"""


@wp.func
def fastest_between(velocities: wp.array[wp.vec3], first: wp.vec2i, second: wp.vec2i):
    """Return the largest speed of a point of an edge relative to one of another [m/s]."""
    squared = float(0.0)
    for end in range(2):
        for far in range(2):
            between = vector_at(velocities, first[end]) - vector_at(velocities, second[far])
            squared = wp.max(squared, wp.length_sq(between))
    return wp.sqrt(squared)


@wp.func
def are_far(t: Tables, own: wp.int32, first: wp.vec2i, second: wp.vec2i):
    """Return whether two edges of a balloon are not neighbors, so that they may touch."""
    for end in range(2):
        for far in range(2):
            if are_neighbors(t, own, first[end], second[far]):
                return False
    return True


@wp.func
def are_near(first: Swept, second: Swept, pad: float):
    """Return whether two boxes are within a distance in each direction [m]."""
    return boxes_meet(first.lower, first.upper, second.lower, second.upper, pad)


@cache
def measuring_functions(features: Features) -> tuple[Any, Any]:
    """Return the function that measures two edges, and the one that lists those to be measured."""
    pad_between = pad_function(features)
    thickness_between, _ = skin_functions(features)

    @wp.func
    def measure(
        t: Tables, working: Working, world: wp.int32, edge: wp.int32, other: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """List a pair of edges if they may touch until the next search."""
        ends = int_pair_at(t.touch.edges, edge)
        there = int_pair_at(t.touch.edges, other)
        own = int_at(t.particles.balloon, ends[0])
        balloon = int_at(t.particles.balloon, there[0])
        if wp.static(features.touches_itself):
            if own == balloon and not are_far(t, own, ends, there):
                return
        gap = crossing_of(
            vector_at(points, ends[0]), vector_at(points, ends[1]),
            vector_at(points, there[0]), vector_at(points, there[1]),
        ).gap  # fmt: skip
        if wp.static(features.touches_itself):
            if own == balloon and has_strayed(working, world, own):
                wp.atomic_min(working.edge_clearances, world, edge, gap)
        fastest = fastest_between(velocities, ends, there)
        if gap < pad_between(t, world, own, balloon) + t.touch.seconds * fastest:
            place = next_place(working.list_lengths, world, PAIRS)
            if place < working.edge_pairs.shape[1]:
                kept = KEPT * thickness_between(t, world, own, balloon)
                due = clear_substeps(t, own, balloon, gap, kept, fastest)
                working.edge_pairs[world, place] = wp.vec3i(edge, other, due)
            else:
                ask_for_room(working, world, OF_PAIRS, place + 1, 1)

    @wp.func
    def compare_with_leaf(
        t: Tables, working: Working, world: wp.int32, edge: wp.int32, swept: Swept, leaf: wp.int32, looks: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """List pairs of an edge and those of a leaf, of a higher number, to be measured where their boxes meet."""
        its_edges = int_pair_at(t.touch.part_edges, leaf)
        for other in range(wp.max(its_edges[0], edge + 1), its_edges[1]):
            if are_near(swept, box_of_edge(working, world, other), looks):
                place = next_place(working.list_lengths, world, BOXED)
                if place < working.boxed_edges.shape[1]:
                    working.boxed_edges[world, place] = wp.vec2i(edge, other)
                else:
                    measure(t, working, world, edge, other, points, velocities)

    return measure, compare_with_leaf


@cache
def measuring_kernel(features: Features) -> Any:
    """Return the kernel that measures the pairs of edges whose boxes meet."""
    measure, _ = measuring_functions(features)

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=FIND_EDGES_REGISTERS, module_options=OPTIONS)
    def measure_edges(
        # model
        t: Tables,
        threads: wp.int32,
        turns: wp.int32,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        working: Working,
    ):
        """List the pairs of edges that may touch, by some threads a world."""
        world, thread = wp.tid()
        if is_searched(working, world):
            count = wp.min(working.list_lengths[world, BOXED], working.boxed_edges.shape[1])
            for place in range(thread, count, threads):
                pair = working.boxed_edges[world, place]
                measure(t, working, world, pair[0], pair[1], points[world], velocities[world])

    return measure_edges


@cache
def seeking_function(features: Features) -> Any:
    """Return the function that tells whether an edge may have to go through the tree of a balloon."""

    @wp.func
    def seeks_in(t: Tables, working: Working, world: wp.int32, edge: wp.int32, own: wp.int32, balloon: wp.int32):
        if wp.static(features.touches_itself):
            if balloon == own:
                return working.near_part_counts[world, int_at(t.touch.edge_homes, edge)] < 0
        return balloon > own

    return seeks_in


@cache
def trees_kernel(features: Features) -> Any:
    """Return the kernel in which edges go through trees."""
    pad_between, seeks_in = pad_function(features), seeking_function(features)
    _, compare_with_leaf = measuring_functions(features)

    @wp.func
    def go_through(
        t: Tables, working: Working, world: wp.int32, edge: wp.int32, own: wp.int32, balloon: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """List the edges of a balloon that an edge may touch, of its own those of a higher number."""
        swept = box_of_edge(working, world, edge)
        looks = float(pad_between(t, world, own, balloon))
        at = int_at(t.touch.balloon_parts, balloon)
        last = int_at(t.touch.balloon_parts, balloon + 1)
        if balloon == own:
            looks = pad_with_lookout(t, working, world, own, looks)
            at = wp.max(at, int_at(t.touch.edge_homes, edge))
        while at < last:
            after = four_ints_at(t.touch.parts, at)[0]
            if are_near(swept, box_of_part(working, world, at), looks):
                compare_with_leaf(t, working, world, edge, swept, at, looks, points, velocities)
                after = at + 1
            at = after

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=FIND_EDGES_REGISTERS, module_options=OPTIONS)
    def find_edges_in_trees(
        # model
        t: Tables,
        threads: wp.int32,
        turns: wp.int32,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        working: Working,
    ):
        """Find the edges near those that seek any, by some threads a world."""
        world, thread = wp.tid()
        if is_searched(working, world):
            count = working.list_lengths[world, SEEKING]
            are_all = count > working.seeking_edges.shape[1]  # not listed all
            for place in range(thread, wp.where(are_all, t.touch.edges.shape[0], count), threads):
                sought = wp.vec2i(place, 0)
                trees = wp.int32(1)
                if not are_all:
                    sought = working.seeking_edges[world, place]
                own = int_at(t.particles.balloon, int_pair_at(t.touch.edges, sought[0])[0])
                if are_all:
                    trees = working.neighbor_counts[world, own]
                for tree in range(trees):
                    if are_all:
                        sought[1] = working.neighbors[world, own, tree]
                    if not are_all or seeks_in(t, working, world, sought[0], own, sought[1]):
                        go_through(t, working, world, sought[0], own, sought[1], points[world], velocities[world])

    return find_edges_in_trees


@cache
def leaves_kernel(features: Features) -> Any:
    """Return the kernel that compares edges in leaves of a balloon that are near each other."""
    pad_between = pad_function(features)
    _, compare_with_leaf = measuring_functions(features)

    @wp.func
    def compare_leaves(
        t: Tables, working: Working, world: wp.int32, balloon: wp.int32, part: wp.int32, other: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """List pairs of edges of two leaves, or of a leaf, whose boxes meet."""
        pad = pad_between(t, world, balloon, balloon)
        there = box_of_part(working, world, other)
        edges = int_pair_at(t.touch.part_edges, part)
        for edge in range(edges[0], edges[1]):
            swept = box_of_edge(working, world, edge)
            if are_near(swept, there, pad):
                compare_with_leaf(t, working, world, edge, swept, other, pad, points, velocities)

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=FIND_EDGES_REGISTERS, module_options=OPTIONS)
    def find_edges_in_leaves(
        # model
        t: Tables,
        threads: wp.int32,
        turns: wp.int32,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        working: Working,
    ):
        """Compare edges of leaves near each other, by some threads a world, of which so many share a leaf."""
        world, thread = wp.tid()
        if working.near_balloons[world, working.balloon_boxes.shape[1]] == ARE_NEAR:
            first = int_at(t.touch.levels, 0)
            for place in range(thread, turns * (int_at(t.touch.levels, 1) - first), threads):
                part = int_at(t.touch.parts_by_level, first + place // turns)
                count = working.near_part_counts[world, part]
                balloon = four_ints_at(t.touch.parts, part)[3]
                if count > 0 and working.near_balloons[world, balloon] != ALONE:
                    begin = wp.int32(0)
                    while begin < count and working.near_parts[world, part, begin] < part:
                        begin += 1
                    for at in range(begin + place % turns, count, turns):
                        other = working.near_parts[world, part, at]
                        compare_leaves(t, working, world, balloon, part, other, points[world], velocities[world])

    return find_edges_in_leaves

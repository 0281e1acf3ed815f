"""Search for edges that may touch each other, every few substeps, by the boxes of parts, see `contact.parts`.

A thread takes an edge and goes through the tree of each balloon near it. Of its own balloon it need not where the leaf
it is in has a list of those near, see `contact.near_parts`: a thread takes two such leaves, with some edges each.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.boxes import (
    ALONE,
    ARE_NEAR,
    LOWER,
    UPPER,
    boxes_meet,
    has_strayed,
    is_searched,
    pad_function,
)
from balloon_warp.kernels.contact.clearances import is_clear_of_own, pad_with_lookout
from balloon_warp.kernels.contact.edges import PAIRS, SEEKING
from balloon_warp.kernels.contact.parts import (
    Swept,
    box_of_edge,
    box_of_part,
    put_box_of_edge,
    swept_by_edge,
)
from balloon_warp.kernels.contact.triangles import are_neighbors
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.edges import crossing_of
from balloon_warp.kernels.memory import four_ints_at, int_at, int_pair_at, vector_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.warps import next_place
from balloon_warp.kernels.working import Working

PAIRS_OF_EDGE = 24
"""Number of edges that an edge has room for in the list of pairs of a world, on average"""
FIND_EDGES_REGISTERS = 64
"""Registers of a searching thread, so that more threads overlap their memory latencies"""
TURNS = wp.constant(8)
"""Number of threads that share the list of leaves near a leaf"""


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
def way_of_edge(working: Working, world: wp.int32, ends: wp.vec2i, points: wp.array[wp.vec3]):
    """Return the distance that an edge has moved since the last search [m]."""
    first = wp.length(points[ends[0]] - working.sought[world, ends[0]])
    return wp.max(first, wp.length(points[ends[1]] - working.sought[world, ends[1]]))


@wp.func
def fastest_end(velocities: wp.array[wp.vec3], ends: wp.vec2i):
    """Return the speed of the faster end of an edge [m/s]."""
    return wp.max(wp.length(velocities[ends[0]]), wp.length(velocities[ends[1]]))


@wp.func
def are_near(first: Swept, second: Swept, pad: float):
    """Return whether two boxes are within a distance in each direction [m]."""
    return boxes_meet(first.lower, first.upper, second.lower, second.upper, pad)


@wp.func
def list_if_near(
    t: Tables, working: Working, world: wp.int32, edge: wp.int32, other: wp.int32, points: wp.array[wp.vec3],
    velocities: wp.array[wp.vec3], pad: float,
):  # fmt: skip
    """List a pair of edges if they may touch until the next search; return the distance between them [m]."""
    ends = int_pair_at(t.touch.edges, edge)
    there = int_pair_at(t.touch.edges, other)
    gap = crossing_of(
        vector_at(points, ends[0]), vector_at(points, ends[1]), vector_at(points, there[0]), vector_at(points, there[1])
    ).gap
    if gap < pad + t.touch.seconds * fastest_between(velocities, ends, there):
        place = next_place(working.list_lengths, world, PAIRS)
        if place < working.edge_pairs.shape[1]:
            working.edge_pairs[world, place] = wp.vec2i(edge, other)
        else:
            wp.atomic_add(working.overflow, world, 1)
    return gap


@cache
def seeking_kernel(features: Features) -> Any:
    """Return the kernel that boxes edges, and lists those that go through trees."""
    pad_between = pad_function(features)

    @wp.func
    def may_meet_others(t: Tables, working: Working, world: wp.int32, own: wp.int32, swept: Swept):
        """Return whether an edge may come near another balloon, of a higher number, by the box that this sweeps."""
        for neighbor in range(working.neighbor_counts[world, own]):
            balloon = working.neighbors[world, own, neighbor]
            if balloon > own:
                lower = working.balloon_boxes[world, balloon, LOWER]
                upper = working.balloon_boxes[world, balloon, UPPER]
                if boxes_meet(swept.lower, swept.upper, lower, upper, pad_between(t, world, own, balloon)):
                    return True
        return False

    @wp.func
    def seeks_own(
        t: Tables, working: Working, world: wp.int32, own: wp.int32, edge: wp.int32, ends: wp.vec2i,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Return whether an edge has to go through the tree of its own balloon."""
        if working.near_part_counts[world, int_at(t.touch.edge_homes, edge)] >= 0:  # others do so for its leaf
            if has_strayed(working, world, own):
                working.edge_clearances[world, edge] = 0.0
            return False
        moved = way_of_edge(working, world, ends, points)
        speed, pad = fastest_end(velocities, ends), pad_between(t, world, own, own)
        return not is_clear_of_own(t, working, world, own, edge, working.edge_clearances, moved, speed, pad)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def find_seeking_edges(
        # model
        t: Tables,
        threads: wp.int32,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        working: Working,
    ):
        """Box edges of balloons that may touch any, and list those that seek others, by some threads a world."""
        world, thread = wp.tid()
        if working.near_balloons[world, working.balloon_boxes.shape[1]] == ARE_NEAR:
            for edge in range(thread, t.touch.edges.shape[0], threads):
                ends = int_pair_at(t.touch.edges, edge)
                own = int_at(t.particles.balloon, ends[0])
                if working.near_balloons[world, own] != ALONE:
                    swept = swept_by_edge(t, ends, points[world], velocities[world])
                    put_box_of_edge(working, world, edge, swept)
                    within = bool(False)
                    seeks = may_meet_others(t, working, world, own, swept)
                    if wp.static(features.touches_itself):
                        within = seeks_own(t, working, world, own, edge, ends, points[world], velocities[world])
                    if seeks or within:
                        place = next_place(working.list_lengths, world, SEEKING)
                        working.seeking_edges[world, place] = 2 * edge + wp.where(within, 1, 0)

    return find_seeking_edges


@cache
def trees_kernel(features: Features) -> Any:
    """Return the kernel in which edges go through trees."""
    pad_between = pad_function(features)

    @wp.func
    def go_through(
        t: Tables, working: Working, world: wp.int32, edge: wp.int32, own: wp.int32, balloon: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """List the edges of a balloon that an edge may touch; of its own those of a higher number."""
        swept = box_of_edge(working, world, edge)
        pad = pad_between(t, world, own, balloon)
        looks = float(pad)
        home = wp.int32(0)
        if balloon == own:
            looks = pad_with_lookout(t, working, world, own, pad)
            home = int_at(t.touch.edge_homes, edge)
        least = float(looks)
        at = int_at(t.touch.balloon_parts, balloon)
        last = int_at(t.touch.balloon_parts, balloon + 1)
        while at < last:
            after = four_ints_at(t.touch.parts, at)[0]
            if after > home and are_near(swept, box_of_part(working, world, at), looks):  # both would find each other
                its_edges = int_pair_at(t.touch.part_edges, at)
                for other in range(wp.max(its_edges[0], edge + 1), its_edges[1]):
                    near = are_near(swept, box_of_edge(working, world, other), looks)
                    if wp.static(features.touches_itself):
                        if near and balloon == own:
                            ends = int_pair_at(t.touch.edges, edge)
                            near = are_far(t, own, ends, int_pair_at(t.touch.edges, other))
                    if near:
                        least = wp.min(least, list_if_near(t, working, world, edge, other, points, velocities, pad))
                after = at + 1
            at = after
        return least

    @wp.kernel(
        module="unique",
        enable_backward=False,
        cuda_max_registers=FIND_EDGES_REGISTERS,
        module_options=OPTIONS,
    )
    def find_edges_in_trees(
        # model
        t: Tables,
        threads: wp.int32,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        working: Working,
    ):
        """Find the edges near those that seek any, by some threads a world."""
        world, thread = wp.tid()
        if is_searched(working, world):
            for place in range(thread, working.list_lengths[world, SEEKING], threads):
                sought = working.seeking_edges[world, place]
                edge = sought >> 1
                own = int_at(t.particles.balloon, int_pair_at(t.touch.edges, edge)[0])
                for neighbor in range(working.neighbor_counts[world, own]):
                    balloon = working.neighbors[world, own, neighbor]
                    if balloon > own or (balloon == own and (sought & 1) == 1):
                        least = go_through(t, working, world, edge, own, balloon, points[world], velocities[world])
                        if wp.static(features.touches_itself):
                            if balloon == own and has_strayed(working, world, own):
                                working.edge_clearances[world, edge] = least

    return find_edges_in_trees


@cache
def leaves_kernel(features: Features) -> Any:
    """Return the kernel that finds edges in leaves of a balloon that are near each other."""
    pad_between = pad_function(features)

    @wp.func
    def compare_leaves(
        t: Tables, working: Working, world: wp.int32, balloon: wp.int32, part: wp.int32, other: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """List pairs of edges of two leaves, or of a leaf, that may touch."""
        pad = pad_between(t, world, balloon, balloon)
        there = box_of_part(working, world, other)
        edges = int_pair_at(t.touch.part_edges, part)
        others = int_pair_at(t.touch.part_edges, other)
        for edge in range(edges[0], edges[1]):
            swept = box_of_edge(working, world, edge)
            if are_near(swept, there, pad):
                for beside in range(wp.max(others[0], edge + 1), others[1]):
                    if are_near(swept, box_of_edge(working, world, beside), pad):
                        ends = int_pair_at(t.touch.edges, edge)
                        if are_far(t, balloon, ends, int_pair_at(t.touch.edges, beside)):
                            list_if_near(t, working, world, edge, beside, points, velocities, pad)

    @wp.kernel(
        module="unique",
        enable_backward=False,
        cuda_max_registers=FIND_EDGES_REGISTERS,
        module_options=OPTIONS,
    )
    def find_edges_in_leaves(
        # model
        t: Tables,
        threads: wp.int32,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        working: Working,
    ):
        """Find edges that may touch in leaves near each other, by some threads a world."""
        world, thread = wp.tid()
        if working.near_balloons[world, working.balloon_boxes.shape[1]] == ARE_NEAR:
            first = int_at(t.touch.levels, 0)
            for place in range(thread, TURNS * (int_at(t.touch.levels, 1) - first), threads):
                part = int_at(t.touch.parts_by_level, first + place // TURNS)
                count = working.near_part_counts[world, part]
                balloon = four_ints_at(t.touch.parts, part)[3]
                if count > 0 and working.near_balloons[world, balloon] != ALONE:
                    begin = wp.int32(0)
                    while begin < count and working.near_parts[world, part, begin] < part:
                        begin += 1
                    for at in range(begin + place % TURNS, count, TURNS):
                        other = working.near_parts[world, part, at]
                        compare_leaves(t, working, world, balloon, part, other, points[world], velocities[world])

    return find_edges_in_leaves

"""Search for edges that may touch each other, every few substeps, by the boxes of parts, see `contact.parts`."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.boxes import boxes_meet, has_strayed, is_searched, pad_function
from balloon_warp.kernels.contact.clearances import is_clear_of_own, pad_with_lookout
from balloon_warp.kernels.contact.edges import PAIRS
from balloon_warp.kernels.contact.near_parts import begin_of_parts, end_of_parts, part_of_search
from balloon_warp.kernels.contact.nearby import Distances, slot_for
from balloon_warp.kernels.contact.parts import (
    lower_of_edge,
    lower_of_part,
    swept_by_edge,
    upper_of_edge,
    upper_of_part,
)
from balloon_warp.kernels.contact.triangles import are_neighbors
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.edges import crossing_of, is_within
from balloon_warp.kernels.memory import four_ints_at, int_pair_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working

MOST_EDGES = wp.constant(24)
"""Largest number of edges that an edge keeps: the nearest"""
FIND_EDGES_REGISTERS = 64
"""Registers of a searching thread, so that more threads overlap their memory latencies"""


@wp.func
def fastest_between(velocities: wp.array[wp.vec3], first: wp.vec2i, second: wp.vec2i):
    """Return the largest speed of a point of an edge relative to one of another [m/s]."""
    squared = float(0.0)
    for end in range(2):
        for far in range(2):
            squared = wp.max(squared, wp.length_sq(velocities[first[end]] - velocities[second[far]]))
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


@cache
def finding_edges_function(features: Features) -> Any:
    """Return the function that finds the edges that an edge may touch, of its balloon's number and above."""
    pad_between = pad_function(features)

    @wp.func
    def find_edges(
        t: Tables, working: Working, world: wp.int32, edge: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        ends = t.touch.edges[edge]
        swept = swept_by_edge(t, ends, points, velocities)
        a = points[ends[0]]
        b = points[ends[1]]
        own = t.particles.balloon[ends[0]]
        home = t.touch.edge_homes[edge]
        kept = Distances()
        count = wp.int32(0)
        for neighbor in range(working.neighbor_counts[world, own]):
            balloon = working.neighbors[world, own, neighbor]
            pad = pad_between(t, world, own, balloon)
            looks = float(pad)
            listed = wp.int32(-1)
            skips = balloon < own
            if wp.static(features.touches_itself):
                if balloon == own:
                    listed = working.near_part_counts[world, home]
                    looks = pad_with_lookout(t, working, world, own, pad)
                    moved = way_of_edge(working, world, ends, points)
                    speed = fastest_end(velocities, ends)
                    skips = is_clear_of_own(t, working, world, own, edge, working.edge_clearances, moved, speed, pad)
            least = float(looks)
            at = begin_of_parts(t, balloon, listed)
            last = wp.where(skips, at, end_of_parts(t, balloon, listed))
            while at < last:
                part = part_of_search(working, world, home, at, listed)
                its_edges = int_pair_at(t.touch.part_edges, part)
                if listed >= 0 and its_edges[1] <= edge + 1:  # both of a pair would find each other
                    at += 1
                    continue
                low = lower_of_part(working, world, part)
                high = upper_of_part(working, world, part)
                lower = wp.vec3(low[0], low[1], low[2])
                upper = wp.vec3(high[0], high[1], high[2])
                opens = boxes_meet(swept.lower, swept.upper, lower, upper, looks)
                first = wp.where(opens, wp.max(its_edges[0], edge + 1), its_edges[1])
                for other in range(first, its_edges[1]):
                    its_lower = lower_of_edge(working, world, other)
                    near = boxes_meet(swept.lower, swept.upper, its_lower, upper_of_edge(working, world, other), looks)
                    there = t.touch.edges[other]
                    if wp.static(features.touches_itself):
                        near = near and (balloon != own or are_far(t, own, ends, there))
                    if near:
                        crossing = crossing_of(a, b, points[there[0]], points[there[1]])
                        least = wp.min(least, crossing.gap)
                        ways = t.touch.seconds * fastest_between(velocities, ends, there)
                        if crossing.gap < pad + ways:
                            # where an end is nearest, a particle meets a triangle, too
                            distance = wp.where(is_within(crossing), crossing.gap, crossing.gap + pad)
                            slot = slot_for(working, world, kept, distance * distance, count, MOST_EDGES)
                            if slot >= 0:
                                kept[slot] = distance * distance
                                working.edge_candidates[world, edge, slot] = other
                                count = wp.max(count, slot + 1)
                goes_on = opens or listed >= 0
                at = wp.where(goes_on, at + 1, four_ints_at(t.touch.parts, part)[0])
            if wp.static(features.touches_itself):
                if balloon == own and not skips and has_strayed(working, world, own):
                    working.edge_clearances[world, edge] = least
        if count > 0:
            begin = wp.atomic_add(working.list_lengths, world, PAIRS, count)
            for place in range(count):
                working.edge_pairs[world, begin + place] = edge * MOST_EDGES + place

    return find_edges


@cache
def find_edges_kernel(features: Features) -> Any:
    """Return the kernel that finds the edges that may touch."""
    find_edges = finding_edges_function(features)

    @wp.kernel(
        module="unique",
        enable_backward=False,
        cuda_max_registers=FIND_EDGES_REGISTERS,
        module_options=OPTIONS,
    )
    def find_near_edges(
        # model
        t: Tables,
        threads: wp.int32,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        working: Working,
    ):
        """Find the edges near each edge, by some threads a world."""
        world, thread = wp.tid()
        if is_searched(working, world):
            for edge in range(thread, t.touch.edges.shape[0], threads):
                find_edges(t, working, world, edge, points[world], velocities[world])

    return find_near_edges

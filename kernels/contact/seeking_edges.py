"""Edges that seek others: they are boxed, and those listed that go through trees, see `contact.edge_search`."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.boxes import ALONE, ARE_NEAR, LOWER, UPPER, boxes_meet, has_strayed, pad_function
from balloon_warp.kernels.contact.clearances import is_clear_of_own, pad_with_lookout
from balloon_warp.kernels.contact.list_lengths import SEEKING
from balloon_warp.kernels.contact.parts import Swept, put_box_of_edge, swept_by_edge
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.memory import int_at, int_pair_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.warps import next_place
from balloon_warp.kernels.working import Working


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
def seeking_kernel(features: Features) -> Any:
    """Return the kernel that boxes edges, and lists those that go through trees."""
    pad_between = pad_function(features)

    @wp.func
    def note_seeking(working: Working, world: wp.int32, edge: wp.int32, balloon: wp.int32):
        """List an edge and a balloon whose tree it goes through."""
        place = next_place(working.list_lengths, world, SEEKING)
        if place < working.seeking_edges.shape[1]:
            working.seeking_edges[world, place] = wp.vec2i(edge, balloon)

    @wp.func
    def seek_others(t: Tables, working: Working, world: wp.int32, edge: wp.int32, own: wp.int32, swept: Swept):
        """List the other balloons, of a higher number, that an edge may come near, by the boxes that these sweep."""
        for neighbor in range(working.neighbor_counts[world, own]):
            balloon = working.neighbors[world, own, neighbor]
            if balloon > own:
                lower = working.balloon_boxes[world, balloon, LOWER]
                upper = working.balloon_boxes[world, balloon, UPPER]
                if boxes_meet(swept.lower, swept.upper, lower, upper, pad_between(t, world, own, balloon)):
                    note_seeking(working, world, edge, balloon)

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
        if is_clear_of_own(t, working, world, own, edge, working.edge_clearances, moved, speed, pad):
            return False
        if has_strayed(working, world, own):  # who measures may find less
            working.edge_clearances[world, edge] = pad_with_lookout(t, working, world, own, pad)
        return True

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def find_seeking_edges(
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
        """Box edges of balloons that may touch any, and list those that seek others, by some threads a world."""
        world, thread = wp.tid()
        if working.near_balloons[world, working.balloon_boxes.shape[1]] == ARE_NEAR:
            for edge in range(thread, t.touch.edges.shape[0], threads):
                ends = int_pair_at(t.touch.edges, edge)
                own = int_at(t.particles.balloon, ends[0])
                if working.near_balloons[world, own] != ALONE:
                    swept = swept_by_edge(t, ends, points[world], velocities[world])
                    put_box_of_edge(working, world, edge, swept)
                    seek_others(t, working, world, edge, own, swept)
                    if wp.static(features.touches_itself):
                        if seeks_own(t, working, world, own, edge, ends, points[world], velocities[world]):
                            note_seeking(working, world, edge, own)

    return find_seeking_edges

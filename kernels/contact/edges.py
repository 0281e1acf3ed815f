"""Contact of sharp edges, a block a world.

Each piece of a substep is a launch. A search now and then finds edges that are near each other; these push each other
apart, one pair after the other, in the same order every time.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.boxes import ALONE, LOWER, UPPER, boxes_meet, is_searched, pad_function
from balloon_warp.kernels.contact.lists import Distances, slot_for
from balloon_warp.kernels.laws.edges import (
    FOUR,
    KEPT,
    crosses,
    crossing_of,
    ease_along,
    friction_of_edges,
    push_apart,
    rub_shares,
    sliding_at,
    weights_of,
)
from balloon_warp.kernels.loops.friction import friction_of_balloons
from balloon_warp.kernels.loops.inertia import ease_function
from balloon_warp.kernels.loops.meeting import skin_functions
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.working import Working

MOST_EDGES = wp.constant(16)
"""Largest number of edges that an edge keeps: the nearest"""
PAIRS = wp.constant(2)
"""Index of the number of edge pairs, after the lengths of lists of particles"""
MOST_SWEEPS = wp.constant(16)
"""Largest number of sweeps over all pairs in a substep; it ends sooner where none comes too near"""
SETTLED = wp.constant(0.01)
"""Fraction of the distance between edges by which they may come nearer in a substep, left to the next one"""


@wp.func
def edge_box(t: Tables, edge: wp.int32, points: wp.array[wp.vec3], velocities: wp.array[wp.vec3]):
    """Return the box that an edge sweeps until the next search [m]."""
    ends = t.touch.edges[edge]
    a = points[ends[0]]
    b = points[ends[1]]
    after_a = a + t.touch.seconds * velocities[ends[0]]
    after_b = b + t.touch.seconds * velocities[ends[1]]
    lower = wp.min(wp.min(a, b), wp.min(after_a, after_b))
    return lower, wp.max(wp.max(a, b), wp.max(after_a, after_b))


@cache
def finding_edges_function(traits: Traits) -> Any:
    """Return the function that finds the edges that an edge may touch, of its balloon's number and above."""
    pad_between = pad_function(traits)

    @wp.func
    def may_meet(t: Tables, own: wp.int32, edge: wp.int32, other: wp.int32):
        """Return whether two edges may touch: on one balloon, only those that were apart at the start."""
        apart = t.touch.apart[own]
        for end in range(2):
            for far in range(2):
                first = t.touch.rest_points[t.touch.edges[edge][end]]
                second = t.touch.rest_points[t.touch.edges[other][far]]
                if wp.length_sq(first - second) < apart * apart:
                    return False
        return True

    @wp.func
    def find_edges(
        t: Tables,
        working: Working,
        world: wp.int32,
        edge: wp.int32,
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):
        own = t.particles.balloon[t.touch.edges[edge][0]]
        a = points[t.touch.edges[edge][0]]
        b = points[t.touch.edges[edge][1]]
        lower, upper = edge_box(t, edge, points, velocities)
        kept = Distances()
        count = wp.int32(0)
        begin = wp.where(wp.static(traits.touches_itself), own, own + 1)
        for balloon in range(begin, working.balloon_boxes.shape[1]):
            pad = pad_between(t, world, own, balloon)
            box_lower = working.balloon_boxes[world, balloon, LOWER]
            box_upper = working.balloon_boxes[world, balloon, UPPER]
            if working.near_balloons[world, own] != ALONE and boxes_meet(lower, upper, box_lower, box_upper, pad):
                first = wp.max(t.touch.balloon_edges[balloon], edge + 1)
                for other in range(first, t.touch.balloon_edges[balloon + 1]):
                    other_lower, other_upper = edge_box(t, other, points, velocities)
                    near = boxes_meet(lower, upper, other_lower, other_upper, pad)
                    if wp.static(traits.touches_itself):
                        near = near and (balloon != own or may_meet(t, own, edge, other))
                    if near:
                        ends = t.touch.edges[other]
                        gap = crossing_of(a, b, points[ends[0]], points[ends[1]]).gap
                        slot = slot_for(working, world, kept, gap * gap, count, MOST_EDGES)
                        if slot >= 0:
                            kept[slot] = gap * gap
                            working.edge_candidates[world, edge, slot] = other
                            count = wp.max(count, slot + 1)
        working.edge_counts[world, edge] = count
        if count > 0:
            wp.atomic_add(working.list_lengths, world, PAIRS, count)

    return find_edges


@cache
def find_edges_kernel(traits: Traits) -> Any:
    """Return the kernel that finds the edges that may touch."""
    find_edges = finding_edges_function(traits)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
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


@cache
def edges_function(traits: Traits) -> Any:
    """Return the function by which edges push each other apart, once all particles have moved."""
    ease_of_moving = ease_function(traits)
    thickness_between, _ = skin_functions(traits)

    @wp.func
    def push_pair(
        t: Tables,
        working: Working,
        world: wp.int32,
        first: wp.int32,
        second: wp.int32,
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):
        """Push two edges apart, and return whether the other pairs have to be tested again."""
        ends = wp.vec4i(
            t.touch.edges[first][0], t.touch.edges[first][1], t.touch.edges[second][0], t.touch.edges[second][1]
        )
        moving = wp.matrix_from_rows(velocities[ends[0]], velocities[ends[1]], velocities[ends[2]], velocities[ends[3]])
        h = t.step_seconds
        crossing = crossing_of(
            points[ends[0]] - h * moving[0], points[ends[1]] - h * moving[1], points[ends[2]] - h * moving[2],
            points[ends[3]] - h * moving[3],
        )  # fmt: skip
        weights = weights_of(crossing.parts)
        kept = KEPT * thickness_between(t, world, t.particles.balloon[ends[0]], t.particles.balloon[ends[2]])
        parting = wp.dot(weights * moving, crossing.normal)
        if push_apart(parting, crossing.gap, kept, 1.0, h) <= 0.0 or wp.length_sq(crossing.normal) == 0.0:
            return False
        eases = wp.vec4()
        for end in range(4):
            eases[end] = ease_of_moving(t, working, world, ends[end])
        push = push_apart(parting, crossing.gap, kept, ease_along(weights, eases), h)
        gains = FOUR()
        for end in range(4):
            gains[end] = (eases[end] * weights[end] * push) * crossing.normal
        if crosses(crossing):
            own = t.particles.balloon[ends[0]]
            most = push * friction_of_balloons(t, world, own, t.particles.balloon[ends[2]])
            slide = sliding_at(crossing, weights, moving + gains)
            shares = rub_shares(crossing, weights, wp.normalize(slide))
            rub = friction_of_edges(wp.length(slide), shares, eases, most)
            for end in range(4):
                gains[end] = gains[end] - (eases[end] * rub) * shares[end]
        for end in range(4):
            velocities[ends[end]] = velocities[ends[end]] + gains[end]
            points[ends[end]] = points[ends[end]] + h * gains[end]
        return h * push_apart(parting, crossing.gap, kept, 1.0, h) > SETTLED * kept

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
        """Resolve contacts of the edges of a world, by the first thread of a block."""
        if thread == 0 and working.list_lengths[world, PAIRS] > 0:
            pushed = bool(True)
            sweep = wp.int32(0)
            while pushed and sweep < MOST_SWEEPS:
                pushed = bool(False)
                sweep += 1
                for edge in range(t.touch.edges.shape[0]):
                    for place in range(working.edge_counts[world, edge]):
                        other = working.edge_candidates[world, edge, place]
                        if push_pair(t, working, world, edge, other, points, velocities):
                            pushed = bool(True)

    return meet_edges

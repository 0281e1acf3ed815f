"""Contact of sharp edges of balloons: the search for pairs, and their contacts.

See `laws.touch`. Particles that would come through triangles are contacts of this kind, too: the spring between a
particle and a triangle, see `laws.touch`, may let it through.

A search finds the edges that may touch each other, every few substeps, by the boxes of parts, see `contact.boxes`.
Threads go through the trees of balloons for edges, or compare those of two leaves of a balloon near each other, see
`contact.triangles`. They list pairs whose boxes meet; others measure these, so that threads of a warp do the same.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.contact.boxes import (
    ALONE,
    ARE_NEAR,
    LOWER,
    UPPER,
    Swept,
    box_of_edge,
    box_of_part,
    boxes_meet,
    exceeds_search_margin,
    is_searched,
    pad_function,
    put_box_of_edge,
    swept_by_edge,
)
from balloon_warp.kernels.contact.contact import NONE, Contact
from balloon_warp.kernels.contact.ends import four_of
from balloon_warp.kernels.contact.kind import Kind, list_contact
from balloon_warp.kernels.contact.triangles import (
    are_neighbors,
    is_clear_of_own,
    pad_with_search_margin,
    side_of,
    triangle_of,
)
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.touch import FOUR, KEPT, couples_of, crosses, crossing_of, separating_shift, weights_of
from balloon_warp.kernels.loops.contact import place_beside, skin_functions
from balloon_warp.kernels.loops.fixtures import friction_of_balloons
from balloon_warp.kernels.memory import four_ints_at, int_at, int_pair_at, vector_at
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import any_in_warp, block_barrier, next_place
from balloon_warp.kernels.working import BOXED, OF_PAIRS, PAIRS, SEEKING, SUBSTEPS, Working, request_capacity

AHEAD = wp.constant(2.0)
"""Number of substeps ahead in which edges at their speeds would touch, so that they count as near in this one"""
SETTLED = wp.constant(0.01)
"""Fraction of the distance that edges keep by which they may come nearer in a substep, left to the next one"""
SAFE = wp.constant(0.2)
"""Fraction of a small distance by which edges may come nearer"""


@wp.func
def of_balloons(normal: wp.vec3, gap: float, thickness: float):
    """Return a contact of balloons a gap apart along a normal, where they keep a part of the thickness."""
    contact = Contact()
    contact.solid = NONE
    contact.normal = normal
    contact.gap = gap
    contact.kept = KEPT * thickness
    contact.left = wp.min(SETTLED * contact.kept, SAFE * gap)
    contact.overlap = separating_shift(gap, contact.kept)
    return contact


@wp.func
def edge_contact(before: FOUR, thickness: float, friction: float):
    """Return the contact of two edges, by the places of their ends."""
    crossing = crossing_of(before[0], before[1], before[2], before[3])
    contact = of_balloons(crossing.normal, crossing.gap, thickness)
    contact.weights = weights_of(crossing.parts)
    if crosses(crossing):
        contact.friction = friction
        first, other = couples_of(crossing)
        contact.couple = first
        contact.other_couple = other
    return contact


@wp.func
def particle_contact(before: FOUR, thickness: float):
    """Return the contact of a triangle and a particle, by the places of the corners and the particle.

    Friction is that of the spring between them.
    """
    place = place_beside(before[3], before[0], before[1], before[2])
    contact = of_balloons(wp.normalize(place.arm), wp.sqrt(place.squared), thickness)
    contact.weights = wp.vec4(-place.weights[0], -place.weights[1], -place.weights[2], 1.0)
    return contact


@wp.func
def clear_substeps(t: Tables, balloon: wp.int32, other: wp.int32, gap: float, kept: float, fastest: float):
    """Return the number of substeps after this one in which two edges of balloons cannot touch yet.

    They may come nearer as fast as they do now, and by as much acceleration as lists allow for.

    Args:
        fastest: Largest speed of a point of one relative to one of the other [m/s].
    """
    way = t.step_seconds * fastest
    gain = (t.touch.slack[balloon] + t.touch.slack[other]) * t.step_seconds / t.touch.seconds
    return int(wp.max(gap - 2.0 * kept - AHEAD * way, 0.0) / (way + gain))


@wp.func
def may_touch(t: Tables, contact: Contact, moving: FOUR):
    """Return whether two edges may touch in this substep."""
    speed = wp.length(contact.weights * moving)
    near = contact.gap < 2.0 * contact.kept + AHEAD * t.step_seconds * speed
    return near and wp.length_sq(contact.normal) > 0.0


@cache
def contact_function(features: Features) -> Any:
    """Return the function that measures two edges, or a particle and a triangle, as a substep begins."""
    thickness_between, _ = skin_functions(features)

    @wp.func
    def edges_of_pair(
        t: Tables, world: wp.int32, first: wp.int32, second: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Return two edges at the start of the substep, whether they may touch in it, and for how many more not."""
        own = t.touch.edges[first]
        other = t.touch.edges[second]
        ends = wp.vec4i(own[0], own[1], other[0], other[1])
        moving = four_of(velocities, ends)
        before = four_of(points, ends) - t.step_seconds * moving
        balloon = t.particles.balloon[own[0]]
        beside = t.particles.balloon[other[0]]
        friction = friction_of_balloons(t, world, balloon, beside)
        contact = edge_contact(before, thickness_between(t, world, balloon, beside), friction)
        contact.ends = ends
        fastest = wp.max(
            wp.max(wp.length(moving[0] - moving[2]), wp.length(moving[0] - moving[3])),
            wp.max(wp.length(moving[1] - moving[2]), wp.length(moving[1] - moving[3])),
        )
        clear = clear_substeps(t, balloon, beside, contact.gap, contact.kept, fastest)
        return contact, may_touch(t, contact, moving), clear

    @wp.func
    def particle_of_pair(
        t: Tables, world: wp.int32, particle: wp.int32, candidate: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Return the same of a particle and a triangle.

        One that is behind the triangle already, and to be pushed out of it, is let through.
        """
        corners = t.touch.triangles[triangle_of(candidate)]
        ends = wp.vec4i(corners[0], corners[1], corners[2], particle)
        moving = four_of(velocities, ends)
        before = four_of(points, ends) - t.step_seconds * moving
        own = t.particles.balloon[particle]
        other = t.particles.balloon[corners[0]]
        contact = particle_contact(before, thickness_between(t, world, own, other))
        contact.ends = ends
        area_vector = wp.cross(before[1] - before[0], before[2] - before[0])
        is_right = other == own or side_of(candidate) * wp.dot(contact.normal, area_vector) >= 0.0
        fastest = wp.max(
            wp.max(wp.length(moving[0] - moving[3]), wp.length(moving[1] - moving[3])),
            wp.length(moving[2] - moving[3]),
        )
        clear = clear_substeps(t, own, other, contact.gap, contact.kept, fastest)
        return contact, is_right and may_touch(t, contact, moving), clear

    @wp.func
    def contact_of(
        t: Tables, working: Working, world: wp.int32, pair: wp.vec2i, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Return a listed pair at the start of the substep, whether it may touch in it, and for how many more not."""
        if pair[0] >= 0:
            return edges_of_pair(t, world, pair[0], pair[1], points, velocities)
        particle = -1 - pair[0]
        candidate = working.candidates[world, particle, pair[1]]
        return particle_of_pair(t, world, particle, candidate, points, velocities)

    return contact_of


@cache
def listing_function(features: Features, backwards: bool) -> Any:
    """Return the function that lists pairs that may touch in a substep, see `kind.Kind`.

    Forward, pairs are left out that cannot touch yet, by how near they were when last measured.
    """
    contact_of = contact_function(features)

    @wp.func
    def next_due(working: Working, world: wp.int32, place: wp.int32, count: wp.int32, substep: wp.int32):
        """Return the place of the next pair of a thread that may touch in a substep, or one beyond the list."""
        if wp.static(not backwards):
            while place < count and working.edge_pairs[world, place][2] > substep:
                place += wp.block_dim()
        return place

    @wp.func
    def list_edges(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """List contacts in any order.

        A thread takes single pairs: where all of an edge or a particle are one's, the others wait for the fullest.
        Each thread first goes on to its next pair that is due, so that those of a warp measure together.
        """
        overlaps = bool(False)
        substep = working.list_lengths[world, SUBSTEPS]
        count = wp.min(working.list_lengths[world, PAIRS], working.edge_pairs.shape[1])
        place = next_due(working, world, thread, count, substep)
        while any_in_warp(place < count):  # or each thread of a warp would measure by itself
            if place < count:
                pair = working.edge_pairs[world, place]
                contact, near, clear = contact_of(t, working, world, wp.vec2i(pair[0], pair[1]), points, velocities)
                if near:
                    contact.pair = place
                    overlaps = list_contact(working, world, contact) or overlaps
                if wp.static(not backwards):
                    working.edge_pairs[world, place] = wp.vec3i(pair[0], pair[1], substep + 1 + clear)
            place = next_due(working, world, place + wp.block_dim(), count, substep)
        block_barrier()
        if thread == 0:
            working.list_lengths[world, SUBSTEPS] = substep + 1
        return overlaps

    return list_edges


EDGES = Kind(lambda features: features.edges_meet, listing_function, 300)
"""Sharp edges of balloons, and particles that would come through triangles"""


@wp.func
def displacement_of_edge(working: Working, world: wp.int32, ends: wp.vec2i, points: wp.array[wp.vec3]):
    """Displacement of an edge since the last search [m]."""
    first = wp.length(points[ends[0]] - working.sought[world, ends[0]])
    return wp.max(first, wp.length(points[ends[1]] - working.sought[world, ends[1]]))


@wp.func
def append_edge_query(working: Working, world: wp.int32, edge: wp.int32, balloon: wp.int32):
    """List an edge and a balloon whose tree it goes through."""
    place = next_place(working.list_lengths, world, SEEKING)
    if place < working.query_edges.shape[1]:
        working.query_edges[world, place] = wp.vec2i(edge, balloon)


@cache
def edge_query_kernel(features: Features) -> Any:
    """Kernel that boxes edges, and lists those that query trees."""
    pad_between = pad_function(features)

    @wp.func
    def query_others(t: Tables, working: Working, world: wp.int32, edge: wp.int32, own: wp.int32, swept: Swept):
        """List the other balloons, of a higher number, that an edge may come near, by the boxes that these sweep."""
        for neighbor in range(working.neighbor_counts[world, own]):
            balloon = working.neighbors[world, own, neighbor]
            if balloon > own:
                lower = working.balloon_boxes[world, balloon, LOWER]
                upper = working.balloon_boxes[world, balloon, UPPER]
                if boxes_meet(swept.lower, swept.upper, lower, upper, pad_between(t, world, own, balloon)):
                    append_edge_query(working, world, edge, balloon)

    @wp.func
    def queries_own(
        t: Tables, working: Working, world: wp.int32, own: wp.int32, edge: wp.int32, ends: wp.vec2i,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Test for an edge that queries the tree of its own balloon."""
        if working.near_part_counts[world, int_at(t.touch.edge_homes, edge)] >= 0:  # others do so for its leaf
            if exceeds_search_margin(working, world, own):
                working.edge_clearances[world, edge] = 0.0
            return False
        moved = displacement_of_edge(working, world, ends, points)
        speed = wp.max(wp.length(velocities[ends[0]]), wp.length(velocities[ends[1]]))
        pad = pad_between(t, world, own, own)
        if is_clear_of_own(t, working, world, own, edge, working.edge_clearances, moved, speed, pad):
            return False
        if exceeds_search_margin(working, world, own):  # who measures may find less
            working.edge_clearances[world, edge] = pad_with_search_margin(t, working, world, own, pad)
        return True

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def find_query_edges(
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
                    query_others(t, working, world, edge, own, swept)
                    if wp.static(features.touches_itself):
                        if queries_own(t, working, world, own, edge, ends, points[world], velocities[world]):
                            append_edge_query(working, world, edge, own)

    return find_query_edges


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
    """Distance test of two edges, and the function that lists pairs for it."""
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
            if own == balloon and exceeds_search_margin(working, world, own):
                wp.atomic_min(working.edge_clearances, world, edge, gap)
        fastest = fastest_between(velocities, ends, there)
        if gap < pad_between(t, world, own, balloon) + t.touch.seconds * fastest:
            place = next_place(working.list_lengths, world, PAIRS)
            if place < working.edge_pairs.shape[1]:
                kept = KEPT * thickness_between(t, world, own, balloon)
                due = clear_substeps(t, own, balloon, gap, kept, fastest)
                working.edge_pairs[world, place] = wp.vec3i(edge, other, due)
            else:
                request_capacity(working, world, OF_PAIRS, place + 1, 1)

    @wp.func
    def compare_with_leaf(
        t: Tables, working: Working, world: wp.int32, edge: wp.int32, swept: Swept, leaf: wp.int32,
        search_distance: float, points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """List pairs of an edge and those of a leaf, of a higher number, to be measured where their boxes meet."""
        its_edges = int_pair_at(t.touch.part_edges, leaf)
        for other in range(wp.max(its_edges[0], edge + 1), its_edges[1]):
            if are_near(swept, box_of_edge(working, world, other), search_distance):
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
def tree_query_function(features: Features) -> Any:
    """Filter of edges that query a balloon's tree."""

    @wp.func
    def needs_tree_query(
        t: Tables, working: Working, world: wp.int32, edge: wp.int32, own: wp.int32, balloon: wp.int32
    ):
        if wp.static(features.touches_itself):
            if balloon == own:
                return working.near_part_counts[world, int_at(t.touch.edge_homes, edge)] < 0
        return balloon > own

    return needs_tree_query


@cache
def trees_kernel(features: Features) -> Any:
    """Kernel of edge queries in trees."""
    pad_between, needs_tree_query = pad_function(features), tree_query_function(features)
    _, compare_with_leaf = measuring_functions(features)

    @wp.func
    def go_through(
        t: Tables, working: Working, world: wp.int32, edge: wp.int32, own: wp.int32, balloon: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """List the edges of a balloon that an edge may touch, of its own those of a higher number."""
        swept = box_of_edge(working, world, edge)
        search_distance = float(pad_between(t, world, own, balloon))
        at = int_at(t.touch.balloon_parts, balloon)
        last = int_at(t.touch.balloon_parts, balloon + 1)
        if balloon == own:
            search_distance = pad_with_search_margin(t, working, world, own, search_distance)
            at = wp.max(at, int_at(t.touch.edge_homes, edge))
        while at < last:
            after = four_ints_at(t.touch.parts, at)[0]
            if are_near(swept, box_of_part(working, world, at), search_distance):
                compare_with_leaf(t, working, world, edge, swept, at, search_distance, points, velocities)
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
            are_all = count > working.query_edges.shape[1]  # not listed all
            for place in range(thread, wp.where(are_all, t.touch.edges.shape[0], count), threads):
                sought = wp.vec2i(place, 0)
                trees = wp.int32(1)
                if not are_all:
                    sought = working.query_edges[world, place]
                own = int_at(t.particles.balloon, int_pair_at(t.touch.edges, sought[0])[0])
                if are_all:
                    trees = working.neighbor_counts[world, own]
                for tree in range(trees):
                    if are_all:
                        sought[1] = working.neighbors[world, own, tree]
                    if not are_all or needs_tree_query(t, working, world, sought[0], own, sought[1]):
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

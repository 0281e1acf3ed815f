"""Contact of sharp edges of balloons: the search for pairs, and their contacts.

See `laws.touch`. Particles that would come through triangles are contacts of this kind, too: the spring between a
particle and a triangle, see `laws.touch`, may let it through.

A search finds the edges that may touch each other, every few substeps, by the boxes of leaves, see `contact.boxes`.
The threads of a warp go through leaves together, each with an edge. Pairs whose boxes meet wait in a queue of the warp
until each thread has one to measure, so that all do the same.
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
    box_at,
    boxes_meet,
    end_of_rows,
    exceeds_search_margin,
    first_rows,
    pad_function,
    put_box,
    row_size,
    swept_by_edge,
    votes_on_leaves,
    votes_on_rows,
    warp_box,
    which_leaves_meet,
    which_rows_meet,
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
from balloon_warp.kernels.warps import (
    QUEUE_WORDS,
    any_in_warp,
    block_barrier,
    first_vote,
    next_place,
    of_thread,
    put_in_queue,
    shared_words,
    take_from_queue,
    votes_of_warp,
    warp_size,
)
from balloon_warp.kernels.working import OF_PAIRS, PAIRS, SUBSTEPS, Working, request_capacity

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


@cache
def measuring_function(features: Features) -> Any:
    """Return the function that lists two edges if they may touch until the next search."""
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

    return measure


QUERY_THREADS = 64
"""Threads of a block that searches for edges: each takes many registers"""
asking = shared_words("edges that look at a balloon", QUERY_THREADS // 32 * QUEUE_WORDS)
queue = shared_words("pairs of edges whose boxes meet", QUERY_THREADS // 32 * QUEUE_WORDS)


@wp.func_native(
    """
    const float* const box = reinterpret_cast<const float*>(boxes.data) + 8 * (size_t)world * (boxes.shape[1] / 2);
    int bits = 0;
    #pragma unroll 4
    for (int edge = begin; edge < end; ++edge) {
#if defined(__CUDA_ARCH__)
        const float4 low = __ldg(reinterpret_cast<const float4*>(box + 8 * (unsigned int)edge));
        const float4 high = __ldg(reinterpret_cast<const float4*>(box + 8 * (unsigned int)edge) + 1);
        const float its_lower[3] = {low.x, low.y, low.z}, its_upper[3] = {high.x, high.y, high.z};
#else
        const float* const its_lower = box + 8 * (unsigned int)edge, *const its_upper = its_lower + 4;
#endif
        float gap = its_lower[0] - upper[0];
        for (int axis = 0; axis < 3; ++axis) {
            gap = wp::max(gap, wp::max(lower[axis] - its_upper[axis], its_lower[axis] - upper[axis]));
        }
        const wp::vec2i other = edges.data[(unsigned int)edge];
        const bool joined = other[0] == ends[0] || other[0] == ends[1] || other[1] == ends[0] || other[1] == ends[1];
        bits |= (gap <= pad && !joined) << (edge - begin);
    }
    return bits;
    """
)
def edges_that_meet(
    boxes: wp.array2d[wp.vec4], edges: wp.array[wp.vec2i], world: wp.int32, begin: wp.int32, end: wp.int32,
    ends: wp.vec2i, lower: wp.vec3, upper: wp.vec3, pad: float,
) -> wp.int32:  # fmt: skip
    """Return a bit for each edge of a leaf whose box is within a distance of another's [m].

    Without those that it joins. A loop without branches, so that loads for several edges overlap.
    """
    ...


@cache
def comparison_with_leaf(features: Features) -> Any:
    """Return the function that compares edges with those of a leaf."""
    measure = measuring_function(features)

    @wp.func
    def measure_queued(
        t: Tables, working: Working, world: wp.int32, pair: wp.vec2i, count: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Measure the last pairs of the queue, a warp's, and return its length after it."""
        first = count - warp_size()
        queued = take_from_queue(queue(), first, pair)
        measure(t, working, world, queued[0], queued[1], points, velocities)
        return first

    @wp.func
    def compare_with_leaf(
        t: Tables, working: Working, world: wp.int32, edge: wp.int32, ends: wp.vec2i, asks: bool, swept: Swept,
        leaf: wp.int32, distance: float, count: wp.int32, points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Measure pairs of an edge and those of a leaf, of a higher number; return the queue's length."""
        waiting = wp.int32(count)
        own = four_ints_at(t.touch.leaves, leaf)
        first = wp.max(own[2], edge + 1)
        meets = edges_that_meet(
            working.edge_boxes, t.touch.edges, world, first, own[3], ends, swept.lower, swept.upper, distance
        )
        meets = wp.where(asks, meets, 0)
        while any_in_warp(meets != 0):
            pair = wp.vec2i(edge, first + first_vote(meets))
            waiting = put_in_queue(queue(), meets != 0, pair, waiting)
            meets = meets & (meets - 1)
            if waiting >= warp_size():
                waiting = measure_queued(t, working, world, pair, waiting, points, velocities)
        return waiting

    return compare_with_leaf


@cache
def comparison_function(features: Features, eight: bool) -> Any:
    """Return the function that compares edges with those of the balloons that they look at."""
    pad_between, compare_with_leaf = pad_function(features), comparison_with_leaf(features)
    rows_that_meet = which_rows_meet if eight else votes_on_rows
    leaves_that_meet = which_leaves_meet if eight else votes_on_leaves

    @wp.func
    def compare_with_balloon(
        t: Tables, working: Working, world: wp.int32, edge: wp.int32, ends: wp.vec2i, asks: bool, swept: Swept,
        own: wp.int32, balloon: wp.int32, count: wp.int32, points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Compare edges of a balloon with those of another, or of their own; return the queue's length."""
        waiting = wp.int32(count)
        distance = float(pad_between(t, world, own, balloon))
        home = wp.int32(0)
        if balloon == own:
            distance = pad_with_search_margin(t, working, world, own, distance)
            home = int_at(t.touch.edge_homes, of_thread(edge, first_vote(votes_of_warp(asks))))
            if wp.static(features.touches_itself and eight):
                listed = working.near_leaf_counts[world, home]
                for place in range(listed):
                    leaf = working.near_leaves[world, home, place]
                    if leaf >= home:
                        waiting = compare_with_leaf(
                            t, working, world, edge, ends, asks, swept, leaf, distance, waiting, points, velocities
                        )
                if listed >= 0:
                    return waiting
        around = warp_box(swept, asks)
        rows = first_rows(t, balloon)
        while rows < end_of_rows(t, balloon):
            near_rows = rows_that_meet(t, working, world, rows, around, distance)
            while near_rows != 0:
                row = rows + first_vote(near_rows)
                near_rows = near_rows & (near_rows - 1)
                leaves = leaves_that_meet(t, working, world, balloon, row, around, distance)
                while leaves != 0:
                    leaf = row_size() * row + first_vote(leaves)
                    leaves = leaves & (leaves - 1)
                    if leaf >= home:
                        waiting = compare_with_leaf(
                            t, working, world, edge, ends, asks, swept, leaf, distance, waiting, points, velocities
                        )
            rows += row_size()
        return waiting

    @wp.func
    def compare_asked(
        t: Tables, working: Working, world: wp.int32, asked: wp.vec2i, is_there: bool, count: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Compare edges with the balloons that they look at, if there are any; return the queue's length."""
        queued = wp.int32(count)
        edge, other = asked[0], asked[1]
        ends = int_pair_at(t.touch.edges, edge)
        own = int_at(t.particles.balloon, ends[0])
        swept = box_at(working.edge_boxes, world, edge)
        waiting = votes_of_warp(is_there)
        while waiting != 0:
            first = first_vote(waiting)
            owner, balloon = of_thread(own, first), of_thread(other, first)
            asks = own == owner and other == balloon
            queued = compare_with_balloon(
                t, working, world, edge, ends, is_there and asks, swept, owner, balloon, queued, points, velocities
            )
            waiting = waiting & votes_of_warp(not asks)
        return queued

    return compare_asked


@cache
def asking_function(features: Features) -> Any:
    """Return the function that tests for an edge that looks at a balloon."""
    pad_between = pad_function(features)

    @wp.func
    def asks_own(
        t: Tables, working: Working, world: wp.int32, own: wp.int32, edge: wp.int32, ends: wp.vec2i,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Test for an edge that looks at its own balloon."""
        moved = displacement_of_edge(working, world, ends, points)
        speed = wp.max(wp.length(velocities[ends[0]]), wp.length(velocities[ends[1]]))
        pad = pad_between(t, world, own, own)
        if is_clear_of_own(t, working, world, own, edge, working.edge_clearances, moved, speed, pad):
            return False
        if exceeds_search_margin(working, world, own):  # who measures may find less
            working.edge_clearances[world, edge] = pad_with_search_margin(t, working, world, own, pad)
        return True

    @wp.func
    def asks_balloon(
        t: Tables, working: Working, world: wp.int32, edge: wp.int32, own: wp.int32, other: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Test for an edge that looks at a balloon: its own, or one of a higher number."""
        asks = bool(False)
        if other > own:
            swept = box_at(working.edge_boxes, world, edge)
            lower = working.balloon_boxes[world, other, LOWER]
            upper = working.balloon_boxes[world, other, UPPER]
            asks = boxes_meet(swept.lower, swept.upper, lower, upper, pad_between(t, world, own, other))
        if wp.static(features.touches_itself):
            if other == own:
                asks = asks_own(t, working, world, own, edge, int_pair_at(t.touch.edges, edge), points, velocities)
        return asks

    return asks_balloon


@cache
def query_kernel(features: Features, eight: bool = False) -> Any:
    """Kernel that finds edges near each other.

    The threads of a warp each have an edge, and go through leaves together, those that the box around all may meet.
    They queue edges that look at a balloon, and pairs whose boxes meet, until each thread has one.

    Args:
        eight: whether one thread compares boxes eight at a time.
    """
    compare_asked, asks_balloon = comparison_function(features, eight), asking_function(features)
    measure = measuring_function(features)

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=FIND_EDGES_REGISTERS, module_options=OPTIONS)
    def find_near_edges(
        # model
        t: Tables,
        share: wp.int32,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        working: Working,
    ):
        """Find the edges near each other; each warp of a world has a share of the edges, whole warps of them."""
        world, thread = wp.tid()
        if working.near_balloons[world, working.balloon_boxes.shape[1]] != ARE_NEAR:
            return
        edges = t.touch.edges.shape[0]
        lane = thread % warp_size()
        edge = thread / warp_size() * share + lane
        end = wp.min(edge - lane + share, edges)
        asked, queued = wp.int32(0), wp.int32(0)
        while any_in_warp(edge < end):
            own = wp.int32(-1)
            if edge < end:
                own = int_at(t.particles.balloon, int_pair_at(t.touch.edges, edge)[0])
                if working.near_balloons[world, own] == ALONE:
                    own = wp.int32(-1)
            waiting = votes_of_warp(own >= 0)
            while waiting != 0:
                balloon = of_thread(own, first_vote(waiting))
                for place in range(working.neighbor_counts[world, balloon]):
                    other = working.neighbors[world, balloon, place]
                    asks = bool(False)
                    if own == balloon:
                        asks = asks_balloon(t, working, world, edge, own, other, points[world], velocities[world])
                    if any_in_warp(asks):
                        pair = wp.vec2i(edge, other)
                        asked = put_in_queue(asking(), asks, pair, asked)
                        if asked >= warp_size():
                            asked = asked - warp_size()
                            pair = take_from_queue(asking(), asked, pair)
                            queued = compare_asked(
                                t, working, world, pair, True, queued, points[world], velocities[world]
                            )
                waiting = waiting & votes_of_warp(own >= 0 and own != balloon)
            edge += warp_size()
        pair = take_from_queue(asking(), 0, wp.vec2i())
        if asked > 0:
            pair = wp.where(lane < asked, pair, wp.vec2i())
            queued = compare_asked(t, working, world, pair, lane < asked, queued, points[world], velocities[world])
        pair = take_from_queue(queue(), 0, wp.vec2i())
        if lane < queued:
            measure(t, working, world, pair[0], pair[1], points[world], velocities[world])

    return find_near_edges


@wp.kernel(enable_backward=False)
def box_edges(
    # model
    t: Tables,
    threads: wp.int32,
    # state in
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    # out
    working: Working,
):
    """Box edges of balloons that may touch any, by some threads a world."""
    world, thread = wp.tid()
    if working.near_balloons[world, working.balloon_boxes.shape[1]] == ARE_NEAR:
        for edge in range(thread, t.touch.edges.shape[0], threads):
            ends = int_pair_at(t.touch.edges, edge)
            if working.near_balloons[world, int_at(t.particles.balloon, ends[0])] != ALONE:
                put_box(working.edge_boxes, world, edge, swept_by_edge(t, ends, points[world], velocities[world]))

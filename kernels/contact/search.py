"""Search for triangles near particles, every few substeps: candidates by boxes, and a list for each particle.

Each piece of a substep is a launch. Triangles are found in the same order every time, and in each world by itself.

The particles of a world that search, and those that have found some, are listed: adjacent threads all have work. The
order in a list does not matter.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.contact.boxes import (
    ALONE,
    KNOWN,
    LOWER,
    SEARCHES,
    UPPER,
    box_at,
    box_triangles,
    end_of_rows,
    exceeds_search_margin,
    first_rows,
    is_searched,
    lining_function,
    nearing_function,
    nearing_ones,
    pad_function,
    row_size,
    squared_distance_to_box,
    votes_on_near_leaves,
    votes_on_near_rows,
    which_are_near,
    which_leaves_are_near,
    which_rows_are_near,
)
from balloon_warp.kernels.contact.triangles import (
    are_neighbors,
    candidate_of,
    faced_triangle,
    fastest_of,
    is_behind,
    is_clear_of_own,
    keep_clearance,
    keep_side,
    relative_speed,
    search_margin,
    squared_distance_to_triangle,
    triangle_beside,
    uses_search_margin,
)
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.contact import Place, is_nearer, skin_functions
from balloon_warp.kernels.memory import four_ints_at, int_pair_at, triple_at, vector_at
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import any_in_warp, first_vote, next_place, of_thread, votes_of_warp
from balloon_warp.kernels.working import LOOKING, OF_PAIRS, OF_TRIANGLES, PAIRS, TOUCHING, Working, request_capacity

FAR = wp.constant(1.0e10)
"""Distance beyond all others [m]"""


@cache
def may_touch_function(features: Features) -> Any:
    """Filter of a particle's own triangles that it may touch."""

    @wp.func
    def may_touch(t: Tables, particle: wp.int32, balloon: wp.int32, other: wp.int32, triangle: wp.int32):
        """Return whether a particle may touch a triangle of its own balloon: only if they were apart at the start."""
        if wp.static(features.touches_itself):
            if balloon == other:
                corners = triple_at(t.touch.triangles, triangle)
                for corner in range(3):
                    if are_neighbors(t, balloon, particle, corners[corner]):
                        return False
        return True

    return may_touch


@cache
def coarse_filter_function(features: Features) -> Any:
    """Filter of leaves that may have triangles within reach of a particle."""

    @wp.func
    def may_contain_near(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, balloon: wp.int32, other: wp.int32,
        leaf: wp.int32, point: wp.vec3, squared: float,
    ):  # fmt: skip
        """Test for a leaf that may have triangles within a squared distance [m^2] that the particle may touch."""
        box = box_at(working.leaf_boxes, world, leaf)
        is_near = squared_distance_to_box(point, box.lower, box.upper) <= squared
        if wp.static(features.touches_itself):
            if is_near and balloon == other:
                here = t.touch.rest_points[particle]
                farthest = wp.max(here - t.touch.rest_boxes[leaf, LOWER], t.touch.rest_boxes[leaf, UPPER] - here)
                is_near = wp.length_sq(farthest) >= t.touch.apart[balloon] * t.touch.apart[balloon]
        return is_near

    return may_contain_near


@wp.func
def comes_near(
    t: Tables, points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], particle: wp.int32, triangle: wp.int32,
    most: float, pad: float,
):  # fmt: skip
    """Coarse test for a triangle, whose box is near: it comes near enough, see `TriangleQuery`.

    Args:
        most: Squared distance within which it has to be [m^2].
    """
    if pad >= FAR:
        return True
    squared = squared_distance_to_triangle(t, points, triangle, vector_at(points, particle))
    comes = pad + t.touch.seconds * relative_speed(t, velocities, triangle, vector_at(velocities, particle))
    return squared <= most and squared < comes * comes


@wp.struct
class Seeker:
    """Particle that searches."""

    particle: wp.int32
    home: wp.int32  # its leaf
    balloon: wp.int32
    may_be_deep: bool  # whether it may be deep in other balloons since the start


@wp.struct
class TriangleQuery:
    """Query for the triangles around a particle."""

    home: wp.int32  # leaf of the particle
    within: float  # distance [m]
    skin: float  # part of it without ways until the next search [m]
    reach: float  # distance of boxes of leaves [m]
    pad: float  # distance to which triangles have to come until the next search, by their speeds [m]; or `FAR`
    behind: bool  # whether the particle is behind them, for its list
    beside: wp.int32  # triangle to whose neighbors alone that applies, the others' sides are looked at; -1 for all
    count: wp.int32  # triangles in its list already


@wp.struct
class NearTriangles:
    """Triangles found near a particle."""

    nearest: wp.int32  # triangle; -1 if there is none
    place: Place  # beside that
    count: wp.int32  # triangles in the particle's list, those for which it has no room, too


@cache
def adding_function(lists: bool) -> Any:
    """Return the function that adds a triangle that a particle may touch to the result of a query.

    Args:
        lists: whether it is put into the particle's list; else it is kept if it is the nearest.
    """

    @wp.func
    def with_triangle(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, wanted: TriangleQuery, triangle: wp.int32,
        place: Place, found: NearTriangles,
    ):  # fmt: skip
        if wp.static(lists):
            if place.squared <= found.place.squared:
                if found.count < working.candidates.shape[2]:
                    working.candidates[world, particle, found.count] = candidate_of(
                        triangle,
                        is_behind(t, triangle, place, wanted.behind, wanted.beside),
                        found.count == wanted.count,
                    )
                found.count += 1
        else:
            if is_nearer(place, found.place):
                found.place = place
                found.nearest = triangle
        return found

    return with_triangle


@wp.func_native(
    """
    int bits = 0;
    #pragma unroll 4
    for (int triangle = begin; triangle < end; ++triangle) {
        const wp::vec3i corners = triangles.data[(unsigned int)triangle];
        const wp::vec3 a = points.data[(unsigned int)corners[0]], b = points.data[(unsigned int)corners[1]];
        const wp::vec3 c = points.data[(unsigned int)corners[2]];
        float distance = 0.0f;
        for (int axis = 0; axis < 3; ++axis) {
            const float lower = wp::min(wp::min(a[axis], b[axis]), c[axis]);
            const float upper = wp::max(wp::max(a[axis], b[axis]), c[axis]);
            const float way = wp::max(wp::max(lower - point[axis], point[axis] - upper), 0.0f);
            distance += way * way;
        }
        const bool own = corners[0] == particle || corners[1] == particle || corners[2] == particle;
        bits |= (distance <= 1.00001f * squared && !own) << (triangle - begin);
    }
    return bits;
    """
)
def triangles_within(
    points: wp.array[wp.vec3], triangles: wp.array[wp.vec3i], begin: wp.int32, end: wp.int32, particle: wp.int32,
    point: wp.vec3, squared: float,
) -> wp.int32:  # fmt: skip
    """Return a bit for each triangle of a leaf whose box is within a squared distance of a particle, or hardly more.

    Without those around the particle. A loop without branches, so that loads for several triangles overlap.
    """
    ...


@cache
def query_function(features: Features, lists: bool, eight: bool) -> Any:
    """Return the function that loops over the triangles of a balloon that a particle may touch.

    The threads of a warp execute it together, each for a particle of the same balloon: they go through the leaves that
    the box around all may be near, and look at the same triangle at a time. On a CPU a warp is one thread.

    Args:
        lists: whether it puts them into the particle's list; else it finds the nearest.
        eight: whether one thread compares boxes eight at a time.
    """
    may_touch, may_contain_near = may_touch_function(features), coarse_filter_function(features)
    with_triangle = adding_function(lists)
    near_rows_of = which_rows_are_near if eight else votes_on_near_rows
    near_leaves_of = which_leaves_are_near if eight else votes_on_near_leaves

    @wp.func
    def nearby(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, balloon: wp.int32, other: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], asked: TriangleQuery, asks: bool,
    ):  # fmt: skip
        """Find triangles of another balloon, or of the particle's own, if it asks for them."""
        wanted = asked
        point = vector_at(points, particle)
        # boxes of leaves are of all of their ways
        wanted.reach = wanted.pad + t.touch.seconds * wp.length(vector_at(velocities, particle))
        found = NearTriangles()
        found.nearest = wp.int32(-1)
        found.place.squared = wanted.within * wanted.within
        found.count = wanted.count
        at, listed = wp.int32(0), wp.int32(-1)
        if wp.static(features.touches_itself and eight and not lists):
            if asks and balloon == other:
                listed = working.near_leaf_counts[world, wanted.home]
        row, near_rows, leaves = wp.int32(0), wp.int32(0), wp.int32(0)
        rows, end = first_rows(t, other), end_of_rows(t, other)
        if listed >= 0:
            rows = end
        while at < listed or rows < end or near_rows != 0 or leaves != 0:
            leaf = wp.int32(-1)
            squared = wp.min(found.place.squared, wanted.reach * wanted.reach)
            if at < listed:
                leaf = working.near_leaves[world, wanted.home, at]
                at += 1
            elif leaves != 0:
                leaf = row_size() * row + first_vote(leaves)
                leaves = leaves & (leaves - 1)
            elif near_rows != 0:
                row = rows - row_size() + first_vote(near_rows)
                near_rows = near_rows & (near_rows - 1)
                leaves = near_leaves_of(t, working, world, other, row, point, squared, asks)
            else:
                near_rows = near_rows_of(t, working, world, rows, point, squared, asks)
                rows += row_size()
            near = asks and leaf >= 0
            if near and (wp.static(not eight) or balloon == other):
                near = may_contain_near(t, working, world, particle, balloon, other, leaf, point, squared)
            if any_in_warp(near):
                own = four_ints_at(t.touch.leaves, leaf)
                if wp.static(eight):
                    boxes = working.eight_boxes[world]
                    box_triangles(boxes, leaf, own[0], own[1], t.touch.triangles, points)
                    triangles = which_are_near(boxes, leaf, point, found.place.squared) & ((1 << (own[1] - own[0])) - 1)
                else:
                    within = found.place.squared
                    triangles = triangles_within(points, t.touch.triangles, own[0], own[1], particle, point, within)
                    triangles = wp.where(near, triangles, 0)
                while triangles != 0:
                    triangle = own[0] + first_vote(triangles)
                    triangles = triangles & (triangles - 1)
                    if may_touch(t, particle, balloon, other, triangle):  # not most of those on its own skin
                        if comes_near(t, points, velocities, particle, triangle, found.place.squared, wanted.pad):
                            place = triangle_beside(t, points, triangle, point)
                            found = with_triangle(t, working, world, particle, wanted, triangle, place, found)
        return found

    return nearby


@cache
def nearest_function(features: Features, eight: bool) -> Any:
    """Return the function that finds the triangle of a balloon that is nearest to a particle."""
    nearest_of = query_function(features, lists=False, eight=eight)

    @wp.func
    def nearest_of_balloon(
        t: Tables, working: Working, world: wp.int32, seeker: Seeker, other: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3], asked: TriangleQuery, looks_deep: bool, asks: bool,
    ):  # fmt: skip
        """Find the nearest triangle, or else one as deep as the other balloon lets particles be, if it looks so deep.

        Of its own balloon it looks beyond the distance that counts, to keep how far away the nearest is.
        """
        wanted = asked
        balloon = seeker.balloon
        if wp.static(features.touches_itself):
            if other == balloon:
                if uses_search_margin(t, working, world, balloon):
                    wanted.within = asked.within + search_margin(t, balloon)
                else:
                    wanted.pad = asked.skin
        found = NearTriangles()
        found.nearest = wp.int32(-1)
        looks = bool(asks)
        while any_in_warp(looks):
            nearest = nearest_of(t, working, world, seeker.particle, balloon, other, points, velocities, wanted, looks)
            if looks:
                found = nearest
            wanted.within = wp.where(looks_deep and t.touch.depth[other] > wanted.within, t.touch.depth[other], 0.0)
            looks = looks and found.nearest < 0 and wanted.within > 0.0
        if wp.static(features.touches_itself):
            if asks and other == balloon:
                distance = wp.sqrt(found.place.squared)
                keep_clearance(working, world, balloon, seeker.particle, wp.where(wanted.pad == FAR, distance, 0.0))
                found.nearest = wp.where(distance > asked.within, -1, found.nearest)
        return found

    return nearest_of_balloon


@cache
def finding_function(features: Features, eight: bool = False) -> Any:
    """Return the function that puts the triangles of a balloon that a particle may touch into its list."""
    pad_between = pad_function(features)
    thickness_between, _ = skin_functions(features)
    nearest_of_balloon = nearest_function(features, eight)
    list_those = query_function(features, lists=True, eight=eight)

    @wp.func
    def find_of_balloon(
        t: Tables, state: WorldState, working: Working, world: wp.int32, seeker: Seeker, other: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], count: wp.int32, asks: bool,
    ):  # fmt: skip
        """Add triangles of a balloon to a particle's list, if it asks for them, and return its length."""
        particle, balloon = seeker.particle, seeker.balloon
        hold = state.holds[world, particle][3]
        velocity = vector_at(velocities, particle)
        pad = pad_between(t, world, balloon, other)
        one_sided = other != balloon and t.touch.closed[other] == 1
        wanted = TriangleQuery()
        wanted.home = seeker.home
        wanted.skin = pad
        wanted.within = pad + t.touch.seconds * (wp.length(velocity) + fastest_of(working, world, other))
        wanted.pad = FAR
        wanted.beside = wp.int32(-1)
        wanted.count = count
        looks_deep = one_sided and (seeker.may_be_deep or wp.abs(hold) > t.touch.slack[balloon])
        found = nearest_of_balloon(t, working, world, seeker, other, points, velocities, wanted, looks_deep, asks)
        crossed, lists = bool(False), bool(False)
        deepest = t.touch.depth[other]
        if found.nearest >= 0:
            place = faced_triangle(t, points, found.nearest, found.place)
            side = float(1.0)
            if not one_sided:
                deepest = thickness_between(t, world, balloon, other)
                side = wp.where(hold < 0.0 or (hold == 0.0 and place.gap < 0.0), -1.0, 1.0)
                if wp.static(features.touches_itself):
                    side = wp.where(place.gap < 0.0, -1.0, 1.0)
                    crossed = side * hold < 0.0 and wp.abs(place.gap) < deepest
            comes = t.touch.seconds * relative_speed(t, velocities, found.nearest, velocity)
            if one_sided and seeker.may_be_deep and place.gap < 0.0:
                state.deep[world, particle] = wp.int8(1)  # until it is out
            lists = side * place.gap < pad + comes and side * place.gap > -deepest
            wanted.within = wp.sqrt(place.squared) + pad + 2.0 * comes
            wanted.behind = side < 0.0
            if wp.static(features.touches_itself):
                wanted.beside = wp.where(one_sided, -1, found.nearest)
        length = wp.int32(count)
        if any_in_warp(lists):
            listed = list_those(t, working, world, particle, balloon, other, points, velocities, wanted, lists)
            if lists:
                length = listed.count
                if wp.static(features.touches_itself):
                    if crossed:
                        end = wp.min(length, working.candidates.shape[2])
                        keep_side(t, working, world, particle, found.nearest, hold, deepest, points, count, end)
        return length

    return find_of_balloon


FIND_REGISTERS = 64
"""Registers of a searching thread, so that more threads overlap their memory latencies"""


@wp.func
def put_on_list(working: Working, world: wp.int32, which: wp.int32, number: wp.int32):
    """Append a particle, or its place, to a list, by any thread in any order."""
    place = next_place(working.list_lengths, world, which)
    working.particle_lists[world, which, place] = number


@wp.func
def list_beside_edges(working: Working, world: wp.int32, particle: wp.int32, count: wp.int32):
    """List a particle and its triangles among the pairs of edges: its own number below -1, and places in its list."""
    begin = wp.atomic_add(working.list_lengths, world, PAIRS, count)
    fit = wp.clamp(working.edge_pairs.shape[1] - begin, 0, count)
    for at in range(fit):
        working.edge_pairs[world, begin + at] = wp.vec3i(-1 - particle, at, 0)
    if fit < count:
        request_capacity(working, world, OF_PAIRS, begin + count, count - fit)


@wp.func
def next_of_eight(
    t: Tables, working: Working, world: wp.int32, balloon: wp.int32, begin: wp.int32, point: wp.vec3, velocity: wp.vec3
):  # fmt: skip
    """Return the next balloon that a particle may touch, or -1, and the place after it among the neighbors."""
    place = begin
    count = working.neighbor_counts[world, balloon]
    while place < count:
        near = nearing_ones(t, working, world, place, point, velocity) >> (place & 7)
        if near != 0:
            place = wp.min(place + first_vote(near), count - 1)  # also where places are no numbers, in a blow-up
            return working.neighbors[world, balloon, place], place + 1
        place = ((place >> 3) + 1) << 3
    return -1, count


@cache
def searching_kernel(features: Features, eight: bool = False) -> Any:
    """Return the kernel that finds the particles that search.

    Args:
        eight: whether one thread compares boxes eight at a time.
    """
    is_nearing, line_up_neighbors = nearing_function(features), lining_function(features)
    pad_between = pad_function(features)

    @wp.func
    def is_searching(
        t: Tables, state: WorldState, working: Working, world: wp.int32, particle: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3], is_clear: bool,
    ):  # fmt: skip
        """Test for a particle that may touch a balloon, its own unless it is clear of it, or has touched one so far."""
        balloon = t.particles.balloon[particle]
        used = t.faces.particle_offsets[particle + 1] > t.faces.particle_offsets[particle]
        if used and working.near_balloons[world, balloon] != ALONE:
            point = vector_at(points, particle)
            velocity = vector_at(velocities, particle)
            if wp.static(eight):
                place = wp.int32(0)
                while place < working.neighbor_counts[world, balloon]:
                    other, place = next_of_eight(t, working, world, balloon, place, point, velocity)
                    if other >= 0 and not (is_clear and other == balloon):
                        return True
            else:
                for place in range(working.neighbor_counts[world, balloon]):
                    other = working.neighbors[world, balloon, place]
                    if not (is_clear and other == balloon):
                        if is_nearing(t, working, world, balloon, other, point, velocity):
                            return True
        return state.holds[world, particle][3] != 0.0

    @wp.func
    def append_searching(
        t: Tables, state: WorldState, working: Working, world: wp.int32, particle: wp.int32, place: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """List the place of a particle that searches, and store its position if the last search is outdated."""
        balloon = t.particles.balloon[particle]
        is_clear = bool(False)
        if wp.static(features.touches_itself):
            moved = wp.length(points[particle] - working.sought[world, particle])
            speed = wp.length(velocities[particle])
            pad = pad_between(t, world, balloon, balloon)
            is_clear = is_clear_of_own(t, working, world, balloon, particle, working.clearances, moved, speed, pad)
        if exceeds_search_margin(working, world, balloon):
            working.sought[world, particle] = points[particle]
        if working.near_balloons[world, balloon] != KNOWN:
            working.candidate_counts[world, particle] = 0
        if is_searching(t, state, working, world, particle, points, velocities, is_clear):
            put_on_list(working, world, LOOKING, place)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def find_searching_particles(
        # model
        t: Tables,
        threads: wp.int32,
        # state in
        state: WorldState,
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        working: Working,
    ):
        """Find the particles that search, leaf by leaf, by some threads a world."""
        world, thread = wp.tid()
        if is_searched(working, world):
            for place in range(thread, t.touch.homes.shape[0], threads):
                particle = int_pair_at(t.touch.homes, place)[0]
                if wp.static(eight):
                    before = int_pair_at(t.touch.homes, wp.max(place - 1, 0))[0]
                    line_up_neighbors(t, working, world, particle, wp.where(place > 0, before, -1))
                append_searching(t, state, working, world, particle, place, points[world], velocities[world])

    return find_searching_particles


@cache
def triangles_function(features: Features, eight: bool) -> Any:
    """Return the function that finds the triangles of all balloons that a particle may touch."""
    find_of_balloon, is_nearing = finding_function(features, eight), nearing_function(features)

    @wp.func
    def find_triangles(
        t: Tables, state: WorldState, working: Working, world: wp.int32, seeker: Seeker, searches: bool,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Add triangles to a particle's list, if it searches, and return its length.

        The search extends to the depth of other balloons where a particle may have started, or was pressed in so far;
        not wherever it has come behind a surface, as in crumpled skin, out of which there is no way.
        """
        point = vector_at(points, seeker.particle)
        velocity = vector_at(velocities, seeker.particle)
        count = working.candidate_counts[world, seeker.particle]
        if wp.static(eight):
            place = wp.int32(0)
            while searches and place < working.neighbor_counts[world, seeker.balloon]:
                other, place = next_of_eight(t, working, world, seeker.balloon, place, point, velocity)
                if other >= 0:
                    count = find_of_balloon(
                        t, state, working, world, seeker, other, points, velocities, count, True
                    )  # fmt: skip
        else:
            waiting = votes_of_warp(searches)
            while waiting != 0:
                own = of_thread(seeker.balloon, first_vote(waiting))
                for place in range(working.neighbor_counts[world, own]):
                    other = working.neighbors[world, own, place]
                    asks = searches and seeker.balloon == own
                    asks = asks and is_nearing(t, working, world, own, other, point, velocity)
                    if any_in_warp(asks):
                        count = find_of_balloon(
                            t, state, working, world, seeker, other, points, velocities, count, asks
                        )  # fmt: skip
                waiting = waiting & votes_of_warp(searches and seeker.balloon != own)
        return count

    return find_triangles


@cache
def find_kernel(features: Features, fast_math: bool = False, eight: bool = False) -> Any:
    """Return the kernel that finds the triangles that each searching particle may touch.

    Args:
        eight: whether one thread compares boxes eight at a time, which are lined up before.
    """
    find_triangles, line_up_neighbors = triangles_function(features, eight), lining_function(features)

    @wp.func
    def list_triangles(
        t: Tables, state: WorldState, working: Working, world: wp.int32, home: wp.vec2i, is_there: bool,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """List the triangles that a particle may touch, if it is there and its current ones do not suffice."""
        seeker = Seeker()
        seeker.particle = home[0]
        seeker.home = home[1]
        seeker.balloon = t.particles.balloon[seeker.particle]
        work = working.near_balloons[world, seeker.balloon]
        if is_there and work != KNOWN:
            seeker.may_be_deep = state.deep[world, seeker.particle] == wp.int8(1)
            state.deep[world, seeker.particle] = wp.int8(0)
        count = find_triangles(t, state, working, world, seeker, is_there and work == SEARCHES, points, velocities)
        if is_there:
            room = working.candidates.shape[2]
            if count > room:
                request_capacity(working, world, OF_TRIANGLES, count, count - room)
                count = room
            working.candidate_counts[world, seeker.particle] = count
            if count > 0 or state.holds[world, seeker.particle][3] != 0.0:
                put_on_list(working, world, TOUCHING, seeker.particle)
            if wp.static(features.edges_meet):
                if working.list_lengths[world, PAIRS] > 0:  # edges are near: so particles beside them are looked at
                    list_beside_edges(working, world, seeker.particle, count)

    @wp.kernel(
        module="unique",
        enable_backward=False,
        cuda_max_registers=FIND_REGISTERS,
        module_options={**OPTIONS, "fast_math": fast_math},
    )
    def find_near_triangles(
        # model
        t: Tables,
        threads: wp.int32,
        # state in and out
        state: WorldState,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        working: Working,
    ):
        """Find the triangles near each particle, by some threads a world."""
        world, thread = wp.tid()
        if is_searched(working, world):
            place = wp.int32(thread)
            last = working.list_lengths[world, LOOKING] - 1
            while any_in_warp(place <= last):
                home = int_pair_at(t.touch.homes, working.particle_lists[world, LOOKING, wp.min(place, last)])
                if wp.static(eight):
                    before = int_pair_at(t.touch.homes, working.particle_lists[world, LOOKING, wp.max(place - 1, 0)])
                    line_up_neighbors(t, working, world, home[0], wp.where(place > 0, before[0], -1))
                list_triangles(t, state, working, world, home, place <= last, points[world], velocities[world])
                place += threads

    return find_near_triangles

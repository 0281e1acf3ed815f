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
    begin_of_leaves,
    box_triangles,
    end_of_leaves,
    exceeds_search_margin,
    first_of,
    is_filled,
    is_searched,
    leaf_of_search,
    lining_function,
    lower_of_part,
    nearing_function,
    nearing_ones,
    next_near,
    pad_function,
    squared_distance_to_box,
    upper_of_part,
    which_are_near,
    without_first,
)
from balloon_warp.kernels.contact.triangles import (
    are_neighbors,
    begin_of_parts,
    candidate_of,
    end_of_parts,
    faced_triangle,
    fastest_of,
    is_behind,
    is_clear_of_own,
    keep_clearance,
    keep_side,
    part_of_search,
    place_in_queue,
    relative_speed,
    search_margin,
    squared_distance_to_triangle,
    triangle_beside,
    uses_search_margin,
)
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.contact import Place, is_nearer, skin_functions
from balloon_warp.kernels.memory import four_ints_at, int_at, triple_at, vector_at
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import next_place
from balloon_warp.kernels.working import LOOKING, OF_PAIRS, OF_TRIANGLES, PAIRS, TOUCHING, Working, request_capacity

FAR = wp.constant(1.0e10)
"""Distance beyond all others [m]"""
ROOM = wp.constant(8)
"""Buffer size for triangles that may be near, and for those of one more part, before they are tested"""
Queue = wp.types.vector(length=16, dtype=wp.int32)


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
    """Filter of parts that may have triangles within reach of a particle."""

    @wp.func
    def may_contain_near(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, balloon: wp.int32, other: wp.int32,
        part: wp.int32, point: wp.vec3, squared: float,
    ):  # fmt: skip
        """Test for a part that may have triangles within a squared distance [m^2] that the particle may touch."""
        low = lower_of_part(working, world, part)
        high = upper_of_part(working, world, part)
        lower = wp.vec3(low[0], low[1], low[2])
        upper = wp.vec3(high[0], high[1], high[2])
        is_near = squared_distance_to_box(point, lower, upper) <= squared
        if wp.static(features.touches_itself):
            if is_near and balloon == other:
                here = t.touch.rest_points[particle]
                farthest = wp.max(here - t.touch.rest_boxes[part, LOWER], t.touch.rest_boxes[part, UPPER] - here)
                is_near = wp.length_sq(farthest) >= t.touch.apart[balloon] * t.touch.apart[balloon]
        return is_near

    return may_contain_near


@wp.func
def comes_near(
    t: Tables, points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], particle: wp.int32, triangle: wp.int32,
    most: float, pad: float,
):  # fmt: skip
    """Coarse test for a triangle within a squared distance [m^2] that comes near enough, see `TriangleQuery`."""
    squared = squared_distance_to_triangle(t, points, triangle, vector_at(points, particle))
    if squared <= most and pad < FAR:
        comes = pad + t.touch.seconds * relative_speed(t, velocities, triangle, vector_at(velocities, particle))
        return squared < comes * comes
    return squared <= most


@wp.struct
class Search:
    """Place of a search among the parts of a balloon, and distances within which it looks."""

    home: wp.int32  # leaf whose list of near leaves is searched
    listed: wp.int32  # length of that list; negative where the tree is searched
    at: wp.int32
    last: wp.int32
    of_parts: float  # squared distance of parts [m^2]
    of_triangles: float  # squared distance of triangles [m^2]
    pad: float  # see `TriangleQuery`


@cache
def next_part_function(features: Features) -> Any:
    """Leaf iterator of a tree: leaves that may be near."""
    may_contain_near = coarse_filter_function(features)

    @wp.func
    def next_part(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, balloon: wp.int32, other: wp.int32,
        point: wp.vec3, search: Search,
    ):  # fmt: skip
        """Return the part, without triangles where there is none, and where the search is then."""
        node = wp.vec4i()
        at = search.at
        while at < search.last and node[2] == 0:
            part = part_of_search(working, world, search.home, at, search.listed)
            here = four_ints_at(t.touch.parts, part)
            after = wp.where(search.listed >= 0, at + 1, here[0])
            if may_contain_near(t, working, world, particle, balloon, other, part, point, search.of_parts):
                after = at + 1
                if here[0] == part + 1:
                    node = here
            at = after
        return node, at

    return next_part


@cache
def eight_filling_function(features: Features) -> Any:
    """Queue filler: candidate triangles of a particle.

    It compares eight boxes at a time, see `contact.boxes`: with the same result to the bit.
    """
    may_touch, may_contain_near = may_touch_function(features), coarse_filter_function(features)

    @wp.func
    def fill_queue(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, balloon: wp.int32, other: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], search: Search,
    ):  # fmt: skip
        """Return the queue, its length, and where the search is then."""
        point = vector_at(points, particle)
        boxes = working.eight_boxes[world]
        queue = Queue()
        waiting = wp.int32(0)
        at = search.at
        while at < search.last and waiting <= ROOM:
            if search.listed < 0:
                at = next_near(t, boxes, at, search.last, point, search.of_parts)
            if at < search.last:
                leaf = leaf_of_search(t, working, world, search.home, at, search.listed)
                node = four_ints_at(t.touch.parts, leaf)
                if is_filled(node) and may_contain_near(
                    t, working, world, particle, balloon, other, leaf, point, search.of_parts
                ):
                    box_triangles(boxes, leaf, node[1], node[2], t.touch.triangles, points)
                    near = which_are_near(boxes, leaf, point, search.of_triangles)
                    while near != 0:
                        triangle = node[1] + first_of(near)
                        near = without_first(near)
                        # a row's end, which no box says where places are no numbers, in a blow-up
                        if triangle < node[2] and may_touch(t, particle, balloon, other, triangle):
                            if search.pad >= FAR or comes_near(
                                t, points, velocities, particle, triangle, search.of_triangles, search.pad
                            ):
                                queue[waiting] = triangle
                                waiting += 1
            at += 1
        return queue, waiting, at

    return fill_queue


@wp.struct
class TriangleQuery:
    """Query for the triangles around a particle."""

    within: float  # distance [m]
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
def near_triangles_function(features: Features, lists: bool, eight: bool = False) -> Any:
    """Return the function that loops over the triangles of a balloon that a particle may touch.

    Args:
        lists: whether it puts them into the particle's list; else it finds the nearest.
        eight: whether boxes are compared eight at a time.
    """
    may_touch, next_part, fill_queue = (
        make(features) for make in (may_touch_function, next_part_function, eight_filling_function)
    )
    begin_of, end_of = (begin_of_leaves, end_of_leaves) if eight else (begin_of_parts, end_of_parts)

    @wp.func
    def nearby(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, balloon: wp.int32, other: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], wanted: TriangleQuery,
    ):  # fmt: skip
        """Find triangles of another balloon, or of the particle's own.

        In two steps, which the threads of a warp take together: boxes of parts and of triangles select candidates,
        which are then tested.
        """
        point = vector_at(points, particle)
        first = wanted.count
        found = NearTriangles()
        found.nearest = wp.int32(-1)
        found.place.squared = wanted.within * wanted.within
        found.count = first
        # boxes of parts are of all of their ways
        reach = wanted.pad + t.touch.seconds * wp.length(vector_at(velocities, particle))
        search = Search()
        search.listed = wp.int32(-1)
        search.pad = wanted.pad
        if wp.static(features.touches_itself and not lists):
            if balloon == other:
                search.home = int_at(t.touch.homes, particle)
                search.listed = working.near_part_counts[world, search.home]
        search.at = begin_of(t, other, search.listed)
        search.last = end_of(t, other, search.listed)
        queue = Queue()
        while search.at < search.last:
            search.of_triangles = found.place.squared
            search.of_parts = wp.min(found.place.squared, reach * reach)
            waiting = wp.int32(0)
            if wp.static(eight):
                queue, waiting, at = fill_queue(t, working, world, particle, balloon, other, points, velocities, search)
                search.at = at
            else:
                while search.at < search.last and waiting <= ROOM:
                    node, at = next_part(t, working, world, particle, balloon, other, point, search)
                    search.at = at
                    for triangle in range(node[1], node[2]):
                        if may_touch(t, particle, balloon, other, triangle):  # not most of those near on its own skin
                            if comes_near(t, points, velocities, particle, triangle, search.of_triangles, search.pad):
                                queue[waiting] = triangle
                                waiting += 1
            for turn in range(waiting):
                triangle = queue[turn]
                if wp.static(eight):
                    place = place_in_queue(t, working.eight_places[world], points, queue, turn, waiting, point)
                else:
                    place = triangle_beside(t, points, triangle, point)
                if wp.static(lists):
                    if place.squared <= found.place.squared:
                        if found.count < working.candidates.shape[2]:
                            working.candidates[world, particle, found.count] = candidate_of(
                                triangle,
                                is_behind(t, triangle, place, wanted.behind, wanted.beside),
                                found.count == first,
                            )
                        found.count += 1
                else:
                    if is_nearer(place, found.place):
                        found.place = place
                        found.nearest = triangle
        return found

    return nearby


@cache
def finding_functions(features: Features, eight: bool = False) -> Any:
    """Return the function that puts the triangles of a balloon that a particle may touch into its list."""
    pad_between = pad_function(features)
    thickness_between, _ = skin_functions(features)
    nearest_of = near_triangles_function(features, lists=False, eight=eight)
    list_those = near_triangles_function(features, lists=True, eight=eight)

    @wp.func
    def find_of_balloon(
        t: Tables, state: WorldState, working: Working, world: wp.int32, particle: wp.int32, balloon: wp.int32,
        other: wp.int32, points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], may_be_deep: bool, count: wp.int32,
    ):  # fmt: skip
        """Add triangles of a balloon to a particle's list, and return its length.

        Args:
            may_be_deep: Whether the particle may be deep in the other balloon since the start.
        """
        hold = state.holds[world, particle][3]
        velocity = vector_at(velocities, particle)
        pad = pad_between(t, world, balloon, other)
        one_sided = other != balloon and t.touch.closed[other] == 1
        swept = t.touch.seconds * (wp.length(velocity) + fastest_of(working, world, other))
        within = pad + swept
        wanted = TriangleQuery()
        wanted.within = within
        wanted.pad = FAR
        wanted.beside = wp.int32(-1)
        wanted.count = count
        if wp.static(features.touches_itself):
            if other == balloon:
                if uses_search_margin(t, working, world, balloon):
                    wanted.within = within + search_margin(t, balloon)
                else:
                    wanted.pad = pad
        looks_deep = one_sided and (may_be_deep or wp.abs(hold) > t.touch.slack[balloon])
        found = NearTriangles()
        found.nearest = wp.int32(-1)
        while found.nearest < 0 and wanted.within > 0.0:
            found = nearest_of(t, working, world, particle, balloon, other, points, velocities, wanted)
            wanted.within = wp.where(looks_deep and t.touch.depth[other] > wanted.within, t.touch.depth[other], 0.0)
        if wp.static(features.touches_itself):
            if other == balloon:
                distance = wp.sqrt(found.place.squared)
                keep_clearance(working, world, balloon, particle, wp.where(wanted.pad == FAR, distance, 0.0))
                found.nearest = wp.where(distance > within, -1, found.nearest)
        if found.nearest >= 0:
            place = faced_triangle(t, points, found.nearest, found.place)
            side = float(1.0)
            deepest = t.touch.depth[other]
            crossed = bool(False)
            if not one_sided:
                deepest = thickness_between(t, world, balloon, other)
                side = wp.where(hold < 0.0 or (hold == 0.0 and place.gap < 0.0), -1.0, 1.0)
                if wp.static(features.touches_itself):
                    side = wp.where(place.gap < 0.0, -1.0, 1.0)
                    crossed = side * hold < 0.0 and wp.abs(place.gap) < deepest
            comes = t.touch.seconds * relative_speed(t, velocities, found.nearest, velocity)
            if one_sided and may_be_deep and place.gap < 0.0:
                state.deep[world, particle] = wp.int8(1)  # until it is out
            if side * place.gap < pad + comes and side * place.gap > -deepest:
                wanted.within = wp.sqrt(place.squared) + pad + 2.0 * comes
                wanted.pad = FAR
                wanted.behind = side < 0.0
                if wp.static(features.touches_itself):
                    wanted.beside = wp.where(one_sided, -1, found.nearest)
                listed = list_those(t, working, world, particle, balloon, other, points, velocities, wanted)
                if wp.static(features.touches_itself):
                    if crossed:
                        begin, end = count, wp.min(listed.count, working.candidates.shape[2])
                        keep_side(t, working, world, particle, found.nearest, hold, deepest, points, begin, end)
                count = listed.count
        return count

    return find_of_balloon


FIND_REGISTERS = 64
"""Registers of a searching thread, so that more threads overlap their memory latencies"""


@wp.func
def put_on_list(working: Working, world: wp.int32, which: wp.int32, particle: wp.int32):
    """Append a particle to a list, by any thread in any order."""
    place = next_place(working.list_lengths, world, which)
    working.particle_lists[world, which, place] = particle


@wp.func
def list_beside_edges(working: Working, world: wp.int32, particle: wp.int32, count: wp.int32):
    """List a particle and its triangles among the pairs of edges: its own number below -1, and places in its list."""
    begin = wp.atomic_add(working.list_lengths, world, PAIRS, count)
    fit = wp.clamp(working.edge_pairs.shape[1] - begin, 0, count)
    for at in range(fit):
        working.edge_pairs[world, begin + at] = wp.vec3i(-1 - particle, at, 0)
    if fit < count:
        request_capacity(working, world, OF_PAIRS, begin + count, count - fit)


@cache
def neighbor_function(features: Features) -> Any:
    """Neighbor iterator: balloons that a particle may touch."""
    is_nearing = nearing_function(features)

    @wp.func
    def next_neighbor(
        t: Tables, working: Working, world: wp.int32, balloon: wp.int32, begin: wp.int32, point: wp.vec3,
        velocity: wp.vec3,
    ):  # fmt: skip
        """Return the next balloon, or -1, and the place after it among the neighbors."""
        place = begin
        other = wp.int32(-1)
        while place < working.neighbor_counts[world, balloon] and other < 0:
            nearby = working.neighbors[world, balloon, place]
            if is_nearing(t, working, world, balloon, nearby, point, velocity):
                other = nearby
            place += 1
        return other, place

    return next_neighbor


@wp.func
def next_of_eight(
    t: Tables, working: Working, world: wp.int32, balloon: wp.int32, begin: wp.int32, point: wp.vec3, velocity: wp.vec3
):  # fmt: skip
    """Return the same by eight boxes at a time, see `contact.boxes`."""
    place = begin
    count = working.neighbor_counts[world, balloon]
    while place < count:
        near = nearing_ones(t, working, world, place, point, velocity) >> (place & 7)
        if near != 0:
            place = wp.min(place + first_of(near), count - 1)  # also where places are no numbers, in a blow-up
            return working.neighbors[world, balloon, place], place + 1
        place = ((place >> 3) + 1) << 3
    return -1, count


@cache
def searching_kernel(features: Features, eight: bool = False) -> Any:
    """Return the kernel that finds the particles that search.

    Args:
        eight: whether one thread compares boxes eight at a time.
    """
    is_nearing = nearing_function(features)
    line_up_neighbors = lining_function(features)
    pad_between = pad_function(features)

    @wp.func
    def is_searching(
        t: Tables, state: WorldState, working: Working, world: wp.int32, particle: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3], is_clear: bool,
    ):  # fmt: skip
        """Test for a particle that may touch a balloon, or has touched one until now.

        Args:
            is_clear: Whether it cannot touch its own.
        """
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
        t: Tables, state: WorldState, working: Working, world: wp.int32, particle: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Append a particle that searches to its list, and store its position if the last search is outdated."""
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
            put_on_list(working, world, LOOKING, particle)

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
        """Find the particles that search, by some threads a world."""
        world, thread = wp.tid()
        if is_searched(working, world):
            for particle in range(thread, points.shape[1], threads):
                if wp.static(eight):
                    line_up_neighbors(t, working, world, particle, particle - 1)
                append_searching(t, state, working, world, particle, points[world], velocities[world])

    return find_searching_particles


@cache
def find_kernel(features: Features, fast_math: bool = False, eight: bool = False) -> Any:
    """Return the kernel that finds the triangles that each searching particle may touch.

    Args:
        eight: whether one thread compares boxes eight at a time, which are lined up before.
    """
    find_of_balloon = finding_functions(features, eight)
    next_neighbor = next_of_eight if eight else neighbor_function(features)
    line_up_neighbors = lining_function(features)

    @wp.func
    def list_triangles(
        t: Tables,
        state: WorldState,
        working: Working,
        world: wp.int32,
        particle: wp.int32,
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):
        """Find the triangles of all balloons that a particle may touch, if its current ones do not suffice.

        The search extends to the depth of other balloons where a particle may have started, or was pressed in so far;
        not wherever it has come behind a surface, as in crumpled skin, out of which there is no way.
        """
        balloon = t.particles.balloon[particle]
        point = vector_at(points, particle)
        velocity = vector_at(velocities, particle)
        count = working.candidate_counts[world, particle]
        if working.near_balloons[world, balloon] != KNOWN:
            may_be_deep = state.deep[world, particle] == wp.int8(1)
            state.deep[world, particle] = wp.int8(0)
            if working.near_balloons[world, balloon] == SEARCHES:
                place = wp.int32(0)
                while place < working.neighbor_counts[world, balloon]:
                    other, place = next_neighbor(t, working, world, balloon, place, point, velocity)
                    if other >= 0:
                        count = find_of_balloon(
                            t, state, working, world, particle, balloon, other, points, velocities, may_be_deep, count
                        )
        room = working.candidates.shape[2]
        if count > room:
            request_capacity(working, world, OF_TRIANGLES, count, count - room)
            count = room
        working.candidate_counts[world, particle] = count
        if count > 0 or state.holds[world, particle][3] != 0.0:
            put_on_list(working, world, TOUCHING, particle)
        if wp.static(features.edges_meet):
            if working.list_lengths[world, PAIRS] > 0:  # edges are near, so that particles beside them are looked at
                list_beside_edges(working, world, particle, count)

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
            for place in range(thread, working.list_lengths[world, LOOKING], threads):
                particle = working.particle_lists[world, LOOKING, place]
                if wp.static(eight):
                    before = working.particle_lists[world, LOOKING, wp.max(place - 1, 0)]
                    line_up_neighbors(t, working, world, particle, wp.where(place > 0, before, -1))
                list_triangles(t, state, working, world, particle, points[world], velocities[world])

    return find_near_triangles

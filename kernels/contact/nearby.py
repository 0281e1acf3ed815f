"""Triangles near a particle, to which bounding boxes lead it, see `contact.boxes`: the nearest, or a list of them."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.boxes import LOWER, UPPER, squared_distance_to_box
from balloon_warp.kernels.contact.eight_boxes import (
    begin_of_leaves,
    box_triangles,
    end_of_leaves,
    first_of,
    is_filled,
    leaf_of_search,
    next_near,
    which_are_near,
    without_first,
)
from balloon_warp.kernels.contact.eight_places import place_in_queue
from balloon_warp.kernels.contact.near_parts import begin_of_parts, end_of_parts, part_of_search
from balloon_warp.kernels.contact.parts import lower_of_part, upper_of_part
from balloon_warp.kernels.contact.sides import is_behind
from balloon_warp.kernels.contact.triangles import (
    are_neighbors,
    candidate_of,
    relative_speed,
    squared_distance_to_triangle,
    triangle_beside,
)
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.meeting import Place, is_nearer
from balloon_warp.kernels.memory import four_ints_at, int_at, triple_at, vector_at
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working

MOST_TRIANGLES = wp.constant(40)
"""Largest number of triangles that a particle keeps"""
MOST_OF_BALLOON = wp.constant(24)
"""Largest number of triangles of one balloon that a particle keeps"""
FAR = wp.constant(1.0e10)
"""Distance beyond all others [m]"""
Distances = wp.types.vector(length=24, dtype=wp.float32)
ROOM = wp.constant(8)
"""Buffer size for triangles that may be near, and for those of one more part, before they are tested"""
Queue = wp.types.vector(length=16, dtype=wp.int32)


@wp.func
def slot_for(working: Working, world: wp.int32, kept: Distances, squared: float, count: wp.int32, most: wp.int32):
    """Return the slot of a triangle among a balloon's: the next one, or the farthest one's; -1 if none is farther."""
    slot = count
    if count >= most:
        wp.atomic_add(working.overflow, world, 1)
        slot = wp.int32(-1)
        farthest = squared
        for held in range(most):
            if kept[held] > farthest:
                farthest = kept[held]
                slot = held
    return slot


@wp.struct
class Wanted:
    """Query for the triangles around a particle."""

    within: float  # distance [m]
    pad: float  # distance to which triangles have to come until the next search, by their speeds [m]; or `FAR`
    behind: bool  # whether the particle is behind them, for its list
    beside: wp.int32  # triangle to whose neighbors alone that applies, the others' sides are looked at; -1 for all
    count: wp.int32  # triangles in its list already


@wp.struct
class Nearby:
    """Triangles found near a particle."""

    nearest: wp.int32  # triangle; -1 if there is none
    place: Place  # beside that
    count: wp.int32  # triangles in the particle's list


@cache
def may_touch_function(features: Features) -> Any:
    """Return the function that tells whether a particle may touch a triangle of its own balloon."""

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
def looks_function(features: Features) -> Any:
    """Return the function that tells whether a part may have triangles that a particle may touch."""

    @wp.func
    def looks_into(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, balloon: wp.int32, other: wp.int32,
        part: wp.int32, point: wp.vec3, squared: float,
    ):  # fmt: skip
        """Return whether a part may have triangles within a squared distance [m^2] that the particle may touch."""
        low = lower_of_part(working, world, part)
        high = upper_of_part(working, world, part)
        lower = wp.vec3(low[0], low[1], low[2])
        upper = wp.vec3(high[0], high[1], high[2])
        looks = squared_distance_to_box(point, lower, upper) <= squared
        if wp.static(features.touches_itself):
            if looks and balloon == other:
                here = t.touch.rest_points[particle]
                farthest = wp.max(here - t.touch.rest_boxes[part, LOWER], t.touch.rest_boxes[part, UPPER] - here)
                looks = wp.length_sq(farthest) >= t.touch.apart[balloon] * t.touch.apart[balloon]
        return looks

    return looks_into


@wp.func
def comes_near(
    t: Tables, points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], particle: wp.int32, triangle: wp.int32,
    most: float, pad: float,
):  # fmt: skip
    """Return whether a triangle may be within a squared distance [m^2], and come as near as has to be, see `Wanted`."""
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
    pad: float  # see `Wanted`


@cache
def filling_function(features: Features) -> Any:
    """Return the function that goes on with a search until a queue is filled with triangles that may be near."""
    may_touch, looks_into = may_touch_function(features), looks_function(features)

    @wp.func
    def fill_queue(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, balloon: wp.int32, other: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], search: Search,
    ):  # fmt: skip
        """Return the queue, its length, and where the search is then."""
        point = vector_at(points, particle)
        queue = Queue()
        waiting = wp.int32(0)
        at = search.at
        while at < search.last and waiting <= ROOM:
            node = wp.vec4i()
            while at < search.last and node[2] == 0:  # to the next part that has no others in it
                part = part_of_search(working, world, search.home, at, search.listed)
                here = four_ints_at(t.touch.parts, part)
                after = wp.where(search.listed >= 0, at + 1, here[0])
                if looks_into(t, working, world, particle, balloon, other, part, point, search.of_parts):
                    after = at + 1
                    if here[0] == part + 1:
                        node = here
                at = after
            for triangle in range(node[1], node[2]):
                if may_touch(t, particle, balloon, other, triangle):  # not most of those near on its own skin
                    if comes_near(t, points, velocities, particle, triangle, search.of_triangles, search.pad):
                        queue[waiting] = triangle
                        waiting += 1
        return queue, waiting, at

    return fill_queue


@cache
def eight_filling_function(features: Features) -> Any:
    """Return the function that does so by eight boxes at a time, see `contact.eight_boxes`: the same to the bit."""
    may_touch, looks_into = may_touch_function(features), looks_function(features)

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
                if is_filled(node) and looks_into(
                    t, working, world, particle, balloon, other, leaf, point, search.of_parts
                ):
                    box_triangles(boxes, leaf, node[1], node[2], t.touch.triangles, points)
                    near = which_are_near(boxes, leaf, point, search.of_triangles)
                    while near != 0:
                        triangle = node[1] + first_of(near)
                        near = without_first(near)
                        if may_touch(t, particle, balloon, other, triangle):
                            if search.pad >= FAR or comes_near(
                                t, points, velocities, particle, triangle, search.of_triangles, search.pad
                            ):
                                queue[waiting] = triangle
                                waiting += 1
            at += 1
        return queue, waiting, at

    return fill_queue


@cache
def nearby_function(features: Features, lists: bool, eight: bool = False) -> Any:
    """Return the function that loops over the triangles of a balloon that a particle may touch.

    Args:
        lists: whether it puts them into the particle's list, of too many the nearest; else it finds the nearest.
        eight: whether boxes are compared eight at a time, see `contact.eight_boxes`: with the same result to the bit.
    """
    fill_queue = eight_filling_function(features) if eight else filling_function(features)
    begin_of, end_of = (begin_of_leaves, end_of_leaves) if eight else (begin_of_parts, end_of_parts)

    @wp.func
    def nearby(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, balloon: wp.int32, other: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], wanted: Wanted,
    ):  # fmt: skip
        """Find triangles of another balloon, or of the particle's own.

        In two steps, which the threads of a warp take together: boxes of parts and of triangles select candidates,
        which are then tested.
        """
        point = vector_at(points, particle)
        first = wanted.count
        most = wp.min(MOST_OF_BALLOON, MOST_TRIANGLES - first)
        kept = Distances()
        found = Nearby()
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
        while search.at < search.last:
            search.of_triangles = found.place.squared
            search.of_parts = wp.min(found.place.squared, reach * reach)
            queue, waiting, at = fill_queue(t, working, world, particle, balloon, other, points, velocities, search)
            search.at = at
            for turn in range(waiting):
                triangle = queue[turn]
                if wp.static(eight):
                    place = place_in_queue(t, working.eight_places[world], points, queue, turn, waiting, point)
                else:
                    place = triangle_beside(t, points, triangle, point)
                if wp.static(lists):
                    if place.squared <= found.place.squared:
                        slot = slot_for(working, world, kept, place.squared, found.count - first, most)
                        if slot >= 0:
                            kept[slot] = place.squared
                            working.candidates[world, particle, first + slot] = candidate_of(
                                triangle, is_behind(t, triangle, place, wanted.behind, wanted.beside), slot == 0
                            )
                            found.count = wp.max(found.count, first + slot + 1)
                else:
                    if is_nearer(place, found.place):
                        found.place = place
                        found.nearest = triangle
        return found

    return nearby

"""Triangles near a particle, to which bounding boxes lead it, see `contact.boxes`: the nearest, or a list of them."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.eight_boxes import begin_of_leaves, end_of_leaves
from balloon_warp.kernels.contact.eight_places import place_in_queue
from balloon_warp.kernels.contact.may_be_near import (
    ROOM,
    Queue,
    Search,
    comes_near,
    eight_filling_function,
    may_touch_function,
    next_part_function,
)
from balloon_warp.kernels.contact.near_parts import begin_of_parts, end_of_parts
from balloon_warp.kernels.contact.sides import is_behind
from balloon_warp.kernels.contact.triangles import candidate_of, triangle_beside
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.meeting import Place, is_nearer
from balloon_warp.kernels.memory import int_at, vector_at
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working


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
    count: wp.int32  # triangles in the particle's list, those for which it has no room, too


@cache
def nearby_function(features: Features, lists: bool, eight: bool = False) -> Any:
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
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], wanted: Wanted,
    ):  # fmt: skip
        """Find triangles of another balloon, or of the particle's own.

        In two steps, which the threads of a warp take together: boxes of parts and of triangles select candidates,
        which are then tested.
        """
        point = vector_at(points, particle)
        first = wanted.count
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

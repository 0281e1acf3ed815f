"""Search for triangles that may be near a particle: boxes of parts, and of triangles, select them."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.boxes import LOWER, UPPER, squared_distance_to_box
from balloon_warp.kernels.contact.eight_boxes import (
    box_triangles,
    first_of,
    is_filled,
    leaf_of_search,
    next_near,
    which_are_near,
    without_first,
)
from balloon_warp.kernels.contact.near_parts import part_of_search
from balloon_warp.kernels.contact.parts import lower_of_part, upper_of_part
from balloon_warp.kernels.contact.triangles import are_neighbors, relative_speed, squared_distance_to_triangle
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.memory import four_ints_at, triple_at, vector_at
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working

FAR = wp.constant(1.0e10)
"""Distance beyond all others [m]"""
ROOM = wp.constant(8)
"""Buffer size for triangles that may be near, and for those of one more part, before they are tested"""
Queue = wp.types.vector(length=16, dtype=wp.int32)


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
def next_part_function(features: Features) -> Any:
    """Return the function that goes on to the next part that has no others in it and may be near."""
    looks_into = looks_function(features)

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
            if looks_into(t, working, world, particle, balloon, other, part, point, search.of_parts):
                after = at + 1
                if here[0] == part + 1:
                    node = here
            at = after
        return node, at

    return next_part


@cache
def eight_filling_function(features: Features) -> Any:
    """Return the function that goes on with a search until a queue is filled with triangles that may be near.

    It compares eight boxes at a time, see `contact.eight_boxes`: with the same result to the bit.
    """
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

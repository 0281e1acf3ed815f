"""Triangles beside a particle, and what a list says of them."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.boxes import squared_distance_to_box
from balloon_warp.kernels.loops.meeting import Place, faced, place_beside
from balloon_warp.kernels.memory import triple_at, vector_at
from balloon_warp.kernels.tables import Tables


@wp.func
def candidate_of(triangle: wp.int32, is_behind: bool, is_first: bool):
    """Return the list entry of a triangle.

    Args:
        is_behind: Whether the particle is behind the triangle.
        is_first: Whether the entry is the first of its balloon.
    """
    return 4 * triangle + wp.where(is_first, 2, 0) + wp.where(is_behind, 1, 0)


@wp.func
def triangle_of(candidate: wp.int32):
    """Return the triangle of a list entry."""
    return candidate >> 2


@wp.func
def is_first_of_balloon(candidate: wp.int32):
    """Return whether a list entry is the first of its balloon."""
    return (candidate & 2) != 0


@wp.func
def side_of(candidate: wp.int32):
    """Return 1 where the particle is in front of the triangle, -1 behind."""
    return 1.0 - 2.0 * float(candidate & 1)


@cache
def rows_function(at: Any) -> Any:
    """Return the function for the vectors of a triangle's corners, row by row.

    Args:
        at: the function that reads one.
    """

    @wp.func
    def rows(vectors: Any, corners: wp.vec3i):
        return wp.matrix_from_rows(at(vectors, corners[0]), at(vectors, corners[1]), at(vectors, corners[2]))

    return rows


rows_at = rows_function(vector_at)


@wp.func
def triangle_beside(t: Tables, points: wp.array[wp.vec3], triangle: wp.int32, point: wp.vec3):
    """Return the position of a particle relative to a triangle."""
    corners = rows_at(points, triple_at(t.touch.triangles, triangle))
    return place_beside(point, corners[0], corners[1], corners[2])


@wp.func
def faced_triangle(t: Tables, points: wp.array[wp.vec3], triangle: wp.int32, place: Place):
    """Return the position of a particle relative to a triangle, with normal and gap."""
    corners = rows_at(points, triple_at(t.touch.triangles, triangle))
    return faced(place, corners[0], corners[1], corners[2])


@wp.func
def squared_distance_to_triangle(t: Tables, points: wp.array[wp.vec3], triangle: wp.int32, point: wp.vec3):
    """Return a lower bound of the squared distance to a triangle, that to its box [m^2], which is faster."""
    corners = triple_at(t.touch.triangles, triangle)
    a = vector_at(points, corners[0])
    b = vector_at(points, corners[1])
    c = vector_at(points, corners[2])
    return squared_distance_to_box(point, wp.min(wp.min(a, b), c), wp.max(wp.max(a, b), c))


@wp.func
def relative_speed(t: Tables, velocities: wp.array[wp.vec3], triangle: wp.int32, velocity: wp.vec3):
    """Return the speed of a particle relative to a triangle's center [m/s]."""
    corners = rows_at(velocities, triple_at(t.touch.triangles, triangle))
    mean = (corners[0] + corners[1] + corners[2]) / 3.0
    return wp.length(velocity - mean)

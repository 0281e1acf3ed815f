"""Triangles beside a particle, and their entries in its list."""

import warp as wp

from balloon_warp.kernels.contact.boxes import squared_distance_to_box
from balloon_warp.kernels.loops.meeting import Place, faced, place_beside
from balloon_warp.kernels.memory import triple_at, vector_at
from balloon_warp.kernels.tables import Tables


@wp.func
def are_neighbors(t: Tables, balloon: wp.int32, first: wp.int32, second: wp.int32):
    """Return whether two particles of a balloon were near each other at the start, so that they do not touch."""
    way = vector_at(t.touch.rest_points, second) - vector_at(t.touch.rest_points, first)
    return wp.length_sq(way) < t.touch.apart[balloon] * t.touch.apart[balloon]


@wp.func
def candidate_of(triangle: wp.int32, is_behind: bool, is_first: bool):
    """Return the list entry of a triangle.

    Args:
        is_behind: Whether the particle is behind the triangle.
        is_first: Whether the entry is the first of its balloon.
    """
    return 4 * triangle + wp.where(is_first, 2, 0) + wp.where(is_behind, 1, 0)


@wp.func
def turned(candidate: wp.int32):
    """Return the list entry of a triangle, with the particle on its other side."""
    return candidate ^ 1


@wp.func
def on_side(candidate: wp.int32, place: Place):
    """Return the list entry of a triangle, with the particle on the side of it on which it is."""
    return (candidate & ~1) | wp.where(wp.dot(place.arm, place.area_vector) < 0.0, 1, 0)


@wp.func
def share_corner(t: Tables, first: wp.int32, second: wp.int32):
    """Return whether two triangles have a corner in common."""
    corners = triple_at(t.touch.triangles, first)
    other = triple_at(t.touch.triangles, second)
    shared = bool(False)
    for corner in range(3):
        shared = shared or corners[corner] == other[0] or corners[corner] == other[1] or corners[corner] == other[2]
    return shared


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


@wp.func
def rows_at(vectors: wp.array[wp.vec3], corners: wp.vec3i):
    """Return the vectors of a triangle's corners, row by row."""
    return wp.matrix_from_rows(
        vector_at(vectors, corners[0]), vector_at(vectors, corners[1]), vector_at(vectors, corners[2])
    )


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

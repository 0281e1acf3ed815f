"""Sides of triangles in a particle's list on which the particle is, where layers of a balloon touch each other."""

import warp as wp

from balloon_warp.kernels.contact.triangles import share_corner, side_of, triangle_beside, triangle_of, turned
from balloon_warp.kernels.loops.meeting import Place
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working


@wp.func
def is_behind(t: Tables, triangle: wp.int32, place: Place, behind: bool, beside: wp.int32):
    """Return whether a particle is behind a triangle.

    Args:
        behind: Whether it is behind the nearest one, which counts for all that it joins.
        beside: The nearest one, whose neighbors alone it joins; -1 if it joins all.
    """
    if beside >= 0 and not share_corner(t, triangle, beside):
        return wp.dot(place.arm, place.area_vector) < 0.0
    return behind


@wp.func
def keep_side(
    t: Tables,
    working: Working,
    world: wp.int32,
    particle: wp.int32,
    nearest: wp.int32,
    hold: float,
    within: float,
    points: wp.array[wp.vec3],
    begin: wp.int32,
    end: wp.int32,
):
    """Keep a particle on the side of its nearest triangle on which it was held, unless another one holds it there.

    Args:
        hold: that of the particle, with the side as its sign.
        within: distance at which another one may hold it [m].
    """
    point = vector_at(points, particle)
    for at in range(begin, end):
        candidate = working.candidates[world, particle, at]
        triangle = triangle_of(candidate)
        if side_of(candidate) * hold > 0.0 and not share_corner(t, triangle, nearest):
            place = triangle_beside(t, points, triangle, point)
            if place.squared < within * within:
                return
    for at in range(begin, end):
        candidate = working.candidates[world, particle, at]
        if share_corner(t, triangle_of(candidate), nearest):
            working.candidates[world, particle, at] = turned(candidate)

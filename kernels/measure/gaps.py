"""Distances and crossings of segments and triangles, in float64: for judging others' simulations."""

from typing import Any

import warp as wp

from balloon_warp.kernels.options import OPTIONS

wp.set_module_options(OPTIONS)

Corners = wp.types.matrix(shape=(3, 3), dtype=wp.float64)
"""Corners of a triangle, row by row"""
LEAST = wp.constant(wp.float64(1.0e-60))


@wp.func
def clamped(part: wp.float64):
    """Return a number clamped to [0, 1]."""
    return wp.clamp(part, wp.float64(0.0), wp.float64(1.0))


@wp.func
def segment_gap(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, d: wp.vec3d):
    """Return the distance between the segments ab and cd (Ericson 2004, section 5.1.9)."""
    first = b - a
    second = d - c
    start = a - c
    aa = wp.max(wp.dot(first, first), LEAST)
    ee = wp.max(wp.dot(second, second), LEAST)
    along = wp.dot(first, second)
    x = wp.dot(first, start)
    f = wp.dot(second, start)
    sine = aa * ee - along * along
    s = wp.float64(0.0)
    if sine > wp.float64(1.0e-12) * aa * ee:
        s = clamped((along * f - x * ee) / sine)
    t = clamped((along * s + f) / ee)
    s = clamped((along * t - x) / aa)
    return wp.length(start + s * first - t * second)


@wp.func
def is_over(point: wp.vec3d, tri: Corners, normal: wp.vec3d):
    """Return whether a point's projection on the plane of a triangle is inside the triangle."""
    over = wp.bool(True)
    for corner in range(3):
        begin = tri[corner]
        side = tri[(corner + 1) % 3] - begin
        over = over and wp.dot(wp.cross(side, point - begin), normal) >= wp.float64(0.0)
    return over


@wp.func
def normal_of(tri: Corners):
    """Return a triangle's normal, as long as twice its area."""
    return wp.cross(tri[1] - tri[0], tri[2] - tri[0])


@wp.func
def pierces(p: wp.vec3d, q: wp.vec3d, tri: Corners):
    """Return whether the segment pq goes through a triangle, and where.

    A point on the plane counts as above it.
    """
    normal = normal_of(tri)
    before = wp.dot(normal, p - tri[0])
    after = wp.dot(normal, q - tri[0])
    place = wp.vec3d()
    if (before >= wp.float64(0.0)) == (after >= wp.float64(0.0)):
        return False, place
    place = p + (before / (before - after)) * (q - p)
    way = q - p
    left = wp.dot(way, wp.cross(tri[0] - p, tri[1] - p))
    middle = wp.dot(way, wp.cross(tri[1] - p, tri[2] - p))
    right = wp.dot(way, wp.cross(tri[2] - p, tri[0] - p))
    least = wp.min(wp.min(left, middle), right)
    most = wp.max(wp.max(left, middle), right)
    return least >= wp.float64(0.0) or most <= wp.float64(0.0), place


@wp.func
def triangles_cross(first: Corners, second: Corners):
    """Return whether an edge of one triangle goes through the other, and where."""
    found = wp.bool(False)
    place = wp.vec3d()
    for corner in range(3):
        if not found:
            found, place = pierces(first[corner], first[(corner + 1) % 3], second)
        if not found:
            found, place = pierces(second[corner], second[(corner + 1) % 3], first)
    return found, place


@wp.func
def overlap_along(axis: wp.vec3d, first: Corners, second: Corners):
    """Return how far two triangles overlap along an axis, negative where they are apart [m]."""
    ahead = wp.normalize(axis)
    mine = first * ahead
    other = second * ahead
    return wp.min(wp.max(mine) - wp.min(other), wp.max(other) - wp.min(mine))


@wp.func
def lie_on(first: Corners, second: Corners, blur: wp.float64):
    """Return by how far two triangles that face alike overlap in one plane [m], zero if they do not; and where.

    Those that face each other touch.

    Args:
        blur: Distance up to which they are in one plane [m].
    """
    normal = wp.normalize(normal_of(first))
    other = wp.normalize(normal_of(second))
    overlap = wp.float64(0.0)
    place = wp.vec3d()
    apart = wp.float64(0.0)
    for corner in range(3):
        apart = wp.max(apart, wp.abs(wp.dot(normal, second[corner] - first[0])))
        apart = wp.max(apart, wp.abs(wp.dot(other, first[corner] - second[0])))
    if apart <= blur and wp.dot(normal, other) > wp.float64(0.0):
        overlap = wp.float64(1.0e30)
        inside = wp.float64(0.0)
        for corner in range(3):
            side = first[(corner + 1) % 3] - first[corner]
            overlap = wp.min(overlap, overlap_along(wp.cross(normal, side), first, second))
            side = second[(corner + 1) % 3] - second[corner]
            overlap = wp.min(overlap, overlap_along(wp.cross(normal, side), first, second))
            if is_over(first[corner], second, other):
                place += first[corner]
                inside += wp.float64(1.0)
            if is_over(second[corner], first, normal):
                place += second[corner]
                inside += wp.float64(1.0)
        if inside > wp.float64(0.0):
            place /= inside
        else:
            place = (first[0] + first[1] + first[2] + second[0] + second[1] + second[2]) / wp.float64(6.0)
    return wp.max(overlap, wp.float64(0.0)), place


@wp.func
def depth_of_round(begin: wp.vec3d, end: wp.vec3d, radius: wp.float64, tri: Corners):
    """Return the depth of a triangle in a capsule about a segment; negative where it is outside."""
    normal = wp.normalize(normal_of(tri))
    before = wp.dot(begin - tri[0], normal)
    after = wp.dot(end - tri[0], normal)
    through, _place = pierces(begin, end, tri)
    if through:
        return radius + wp.min(wp.abs(before), wp.abs(after))
    gap = wp.float64(1.0e30)
    for corner in range(3):
        gap = wp.min(gap, segment_gap(begin, end, tri[corner], tri[(corner + 1) % 3]))
    if is_over(begin, tri, normal):
        gap = wp.min(gap, wp.abs(before))
    if is_over(end, tri, normal):
        gap = wp.min(gap, wp.abs(after))
    return radius - gap


@wp.func
def spread(tri: Corners, pad: Any):
    """Lower and upper corner of a box around a triangle, in float32, wider by a pad."""
    lower = wp.min(wp.min(tri[0], tri[1]), tri[2])
    upper = wp.max(wp.max(tri[0], tri[1]), tri[2])
    wide = wp.vec3(float(pad), float(pad), float(pad))
    return wp.vec3(lower) - wide, wp.vec3(upper) + wide

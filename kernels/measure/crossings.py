"""Distances and crossings of triangles, for judging any simulation.

Triangles need not be closed for a signed distance: the side follows from the winding number (Barill et al. 2018, "Fast
winding numbers for soups and clouds").
"""

from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS

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


DOUBLINGS = wp.constant(24)
"""Largest number of doublings of the displacement that frees a face"""
HALVINGS = wp.constant(8)
"""Number of bisections of the interval that then contains it"""


@wp.struct
class Things:
    """The surfaces of all things at a moment, as triangles."""

    tree: wp.uint64
    """Bounding volume tree of the triangles"""
    points: wp.array[wp.vec3d]
    """Positions of points [m]"""
    triangles: wp.array[wp.vec3i]
    vertices: wp.array[wp.int32]
    """First point that is always at the same place, for each point"""
    owners: wp.array[wp.int32]
    """Thing that each triangle belongs to"""
    groups: wp.array[wp.int32]
    """Group of each thing: those of a group do not touch"""
    soft: wp.array[wp.int32]
    """Whether each thing is deformable, and so touches itself"""
    pad: float
    """Padding of boxes for the rounding of float32 [m]"""


@wp.func
def corners_of(things: Things, triangle: wp.int32):
    """Return the corners of a triangle."""
    ends = things.triangles[triangle]
    return wp.matrix_from_rows(things.points[ends[0]], things.points[ends[1]], things.points[ends[2]])


@wp.func
def may_cross(things: Things, first: wp.int32, second: wp.int32):
    """Return whether two triangles should not cross: of things that touch, without a common corner."""
    owner = things.owners[first]
    other = things.owners[second]
    if owner != other:
        return things.groups[owner] != things.groups[other]
    meets = things.soft[owner] != 0
    for end in range(3):
        for far in range(3):
            here = things.vertices[things.triangles[first][end]]
            meets = meets and here != things.vertices[things.triangles[second][far]]
    return meets


@wp.func
def overlap_of(things: Things, first: wp.int32, second: wp.int32):
    """Return how far triangles of two deformable things overlap in one plane [m], and where."""
    owner = things.owners[first]
    other = things.owners[second]
    overlap = wp.float64(0.0)
    place = wp.vec3d()
    if owner != other and things.soft[owner] != 0 and things.soft[other] != 0:
        overlap, place = lie_on(corners_of(things, first), corners_of(things, second), wp.float64(things.pad))
    return overlap, place


@wp.kernel
def find_boxes(things: Things, lowers: wp.array[wp.vec3], uppers: wp.array[wp.vec3]):
    """Compute the box around each triangle, a thread each."""
    i = wp.tid()
    lower, upper = spread(corners_of(things, i), things.pad)
    lowers[i] = lower
    uppers[i] = upper


@wp.kernel
def find_crossings(things: Things, count: wp.array[wp.int32], pairs: wp.array[wp.vec2i]):
    """Find the triangles of higher numbers that each triangle crosses, a thread each."""
    i = wp.tid()
    mine = corners_of(things, i)
    lower, upper = spread(mine, things.pad)
    query = wp.bvh_query_aabb(things.tree, lower, upper)
    j = wp.int32(0)
    while wp.bvh_query_next(query, j):
        if j > i and may_cross(things, i, j):
            crosses, _place = triangles_cross(mine, corners_of(things, j))
            if not crosses:
                overlap, _there = overlap_of(things, i, j)
                crosses = overlap > wp.float64(0.0)
            if crosses:
                slot = wp.atomic_add(count, 0, 1)
                if slot < pairs.shape[0]:
                    pairs[slot] = wp.vec2i(i, j)


@wp.func
def is_free(things: Things, face: wp.int32, other: wp.int32, moved: wp.vec3d):
    """Return whether a displaced face crosses nothing of a thing."""
    mine = corners_of(things, face)
    for corner in range(3):
        mine[corner] = mine[corner] + moved
    lower, upper = spread(mine, things.pad)
    query = wp.bvh_query_aabb(things.tree, lower, upper)
    j = wp.int32(0)
    free = wp.bool(True)
    while wp.bvh_query_next(query, j):
        if free and things.owners[j] == other and j != face and may_cross(things, face, j):
            crosses, _place = triangles_cross(mine, corners_of(things, j))
            free = not crosses
    return free


@wp.func
def separating_displacement(things: Things, face: wp.int32, other: wp.int32, outward: wp.vec3d, least: wp.float64):
    """Return the displacement of a face that frees it from a thing [m]."""
    most = wp.float64(least)
    doubling = wp.int32(0)
    while doubling < DOUBLINGS and not is_free(things, face, other, most * outward):
        most = wp.float64(2.0) * most
        doubling += 1
    low = wp.where(doubling > 0, wp.float64(0.5) * most, wp.float64(0.0))
    for _ in range(HALVINGS):
        middle = wp.float64(0.5) * (low + most)
        if is_free(things, face, other, middle * outward):
            most = middle
        else:
            low = middle
    return most


@wp.kernel
def measure_crossings(
    things: Things,
    pairs: wp.array[wp.vec2i],
    least: wp.float64,
    depths: wp.array[wp.float64],
    places: wp.array[wp.vec3d],
):
    """Measure the displacement along its normal that frees one of two crossing faces; a thread a crossing.

    Of two in one plane it is along that.
    """
    i = wp.tid()
    face = pairs[i][0]
    far = pairs[i][1]
    crosses, place = triangles_cross(corners_of(things, face), corners_of(things, far))
    if not crosses:
        overlap, there = overlap_of(things, face, far)
        depths[i] = overlap
        places[i] = there
        return
    if things.soft[things.owners[face]] == 0:
        face, far = far, face
    outward = wp.normalize(normal_of(corners_of(things, face)))
    other = things.owners[far]
    depths[i] = wp.min(
        separating_displacement(things, face, other, outward, least),
        separating_displacement(things, face, other, -outward, least),
    )
    places[i] = place


@wp.kernel
def measure_rounds(
    things: Things,
    begins: wp.array[wp.vec3d],
    ends: wp.array[wp.vec3d],
    radii: wp.array[wp.float64],
    groups: wp.array[wp.int32],
    depths: wp.array2d[wp.float64],
):
    """Measure how deep a triangle and a capsule are in each other; negative where apart; a thread a pair."""
    i, k = wp.tid()
    depth = wp.float64(-1.0)
    if groups[k] != things.groups[things.owners[i]]:
        tri = Corners(corners_of(things, i))
        depth = depth_of_round(begins[k], ends[k], radii[k], tri)
    depths[i, k] = depth


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def nearest_places(
    mesh: wp.uint64,
    points: wp.array[wp.vec3],
    farthest: float,
    triangles: wp.array[int],
    weights: wp.array[wp.vec3],
):
    """Find the nearest triangle to each point, and the weights of its corners there; a thread a point."""
    i = wp.tid()
    nearest = wp.mesh_query_point_no_sign(mesh, points[i], farthest)
    triangles[i] = nearest.face
    weights[i] = wp.vec3(nearest.u, nearest.v, 1.0 - nearest.u - nearest.v)


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def signed_distances(mesh: wp.uint64, points: wp.array[wp.vec3], farthest: float, distances: wp.array[float]):
    """Measure the distance of each point to the mesh, negative inside by its winding number; a thread a point."""
    i = wp.tid()
    nearest = wp.mesh_query_point_sign_winding_number(mesh, points[i], farthest)
    place = wp.mesh_eval_position(mesh, nearest.face, nearest.u, nearest.v)
    distances[i] = nearest.sign * wp.length(points[i] - place)


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def unsigned_distances(mesh: wp.uint64, points: wp.array[wp.vec3], farthest: float, distances: wp.array[float]):
    """Measure the distance of each point to the mesh; a thread a point."""
    i = wp.tid()
    nearest = wp.mesh_query_point_no_sign(mesh, points[i], farthest)
    place = wp.mesh_eval_position(mesh, nearest.face, nearest.u, nearest.v)
    distances[i] = wp.length(points[i] - place)

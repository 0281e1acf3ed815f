"""Triangles that cross at one time, and their penetration depth."""

import warp as wp

from balloon_warp.kernels.measure.gaps import Corners, depth_of_round, lie_on, normal_of, spread, triangles_cross
from balloon_warp.kernels.options import OPTIONS

wp.set_module_options(OPTIONS)

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
def way_out(things: Things, face: wp.int32, other: wp.int32, outward: wp.vec3d, least: wp.float64):
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
    depths[i] = wp.min(way_out(things, face, other, outward, least), way_out(things, face, other, -outward, least))
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

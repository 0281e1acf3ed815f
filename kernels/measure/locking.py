"""Locking of rubber: the worlds that stretched it beyond its law."""

import warp as wp

from balloon_warp.kernels.laws.membrane import LEAST_DET, invariants_of, is_taut, locking_room, mixed_stretch
from balloon_warp.kernels.measure.worlds import is_torn_triangle
from balloon_warp.kernels.tables import row_of_world

ROUNDED = wp.constant(1.0001)
"""Factor on I1 above which a state counts as beyond the limit"""


@wp.kernel(enable_backward=False)
def note_overstretched(
    # model
    triangles: wp.array[wp.int32],
    triangle_faces: wp.array[wp.int32],
    membrane_corners: wp.array[wp.vec3i],
    membrane_rests: wp.array[wp.vec4],
    particle_balloon: wp.array[wp.int32],
    gent_limit: wp.array2d[float],
    most_stretch: wp.array2d[float],
    wrinkling: wp.array2d[float],
    # state in
    frame: wp.array[wp.int32],
    points: wp.array2d[wp.vec3],
    torn: wp.array2d[float],
    # state out
    overstretched: wp.array[wp.int32],
):
    """Record the first frame of overstretch; a thread a (world, triangle of such rubber)."""
    world, number = wp.tid()
    triangle = triangles[number]
    if overstretched[world] > 0 or is_torn_triangle(torn, triangle_faces, world, triangle):
        return
    p = membrane_corners[triangle]
    balloon = particle_balloon[p[0]]
    d1 = points[world, p[1]] - points[world, p[0]]
    d2 = points[world, p[2]] - points[world, p[0]]
    metric = wp.vec3(wp.dot(d1, d1), wp.dot(d1, d2), wp.dot(d2, d2))
    trace, det, spread = invariants_of(mixed_stretch(metric, membrane_rests[triangle]))
    major = wp.max(0.5 * (trace + spread), 1.0)
    first = trace + 1.0 / wp.max(det, LEAST_DET)
    if not is_taut(det, wp.sqrt(major), wrinkling[row_of_world(world, wrinkling.shape[0]), balloon]):
        first = major + 2.0 / wp.sqrt(major)
    limit = gent_limit[row_of_world(world, gent_limit.shape[0]), balloon]
    most = most_stretch[row_of_world(world, most_stretch.shape[0]), balloon]
    _, most_first = locking_room(limit, most)
    if first > ROUNDED * most_first:
        wp.atomic_max(overstretched, world, frame[0])

"""The place of a surface that is nearest to a point."""

import warp as wp

from balloon_warp.kernels.options import OPTIONS

wp.set_module_options(OPTIONS)


@wp.kernel
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

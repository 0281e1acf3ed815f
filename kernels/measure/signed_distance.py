"""Signed distance to triangles that need not be closed.

The side follows from the winding number (Barill et al. 2018, "Fast winding numbers for soups and clouds").
"""

import warp as wp

from balloon_warp.kernels.options import OPTIONS

wp.set_module_options(OPTIONS)


@wp.kernel
def signed_distances(mesh: wp.uint64, points: wp.array[wp.vec3], farthest: float, distances: wp.array[float]):
    """Measure the distance of each point to the mesh, negative inside by its winding number; a thread a point."""
    i = wp.tid()
    nearest = wp.mesh_query_point_sign_winding_number(mesh, points[i], farthest)
    place = wp.mesh_eval_position(mesh, nearest.face, nearest.u, nearest.v)
    distances[i] = nearest.sign * wp.length(points[i] - place)


@wp.kernel
def unsigned_distances(mesh: wp.uint64, points: wp.array[wp.vec3], farthest: float, distances: wp.array[float]):
    """Measure the distance of each point to the mesh; a thread a point."""
    i = wp.tid()
    nearest = wp.mesh_query_point_no_sign(mesh, points[i], farthest)
    place = wp.mesh_eval_position(mesh, nearest.face, nearest.u, nearest.v)
    distances[i] = wp.length(points[i] - place)

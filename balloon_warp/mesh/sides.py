"""Parts of a surface whose sides are wrong: the outer one inside it, or the inner one outside.

The winding number of a closed surface that faces outward is 1 on its inside and 0 on its outside. Just above a triangle
it is 1 or more where another part of the surface encloses the triangle; just below, it is 0 or less where the surface
is turned inside out.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import triangulate
from balloon_warp.mesh.polygon_mesh import PolygonMesh

NEAR = 0.02
"""Distance above and below a triangle at which samples are tested, over the root of its area"""


class WrongSides(NamedTuple):
    """Triangles of a mesh, as in `triangulate`, whose sides are wrong."""

    areas: NDArray[np.float64]
    """Areas of the triangles, in the mesh's unit squared, shape (triangle_count,)"""
    enclosed: NDArray[np.bool_]
    """Mask of triangles whose outer side lies within the surface, shape (triangle_count,)"""
    reversed: NDArray[np.bool_]
    """Mask of triangles whose inner side lies outside the surface, shape (triangle_count,)"""


def wrong_sides(mesh: PolygonMesh) -> WrongSides:
    """Return the triangles of a closed mesh that lie within it, and those that are turned inside out."""
    from balloon_warp.mesh.mesh_distance import MeshDistance  # takes long to load

    points = mesh.points - mesh.points.mean(axis=0)
    triangles, _ = triangulate(mesh)
    a, b, c = points[triangles].swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    sizes = np.sqrt(np.linalg.norm(normals, axis=1, keepdims=True))
    has_area = sizes[:, 0] > 0.0
    step = NEAR * np.divide(normals, sizes, out=np.zeros_like(normals), where=sizes > 0.0)
    distance, centers = MeshDistance(points, triangles, thickness=0.0), (a + b + c) / 3.0
    enclosed, reversed_ = distance(centers + step) < 0.0, distance(centers - step) > 0.0
    return WrongSides(0.5 * sizes[:, 0] ** 2, has_area & enclosed, has_area & reversed_)

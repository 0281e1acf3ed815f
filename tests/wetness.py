"""Wetted part of a mesh, as trimesh cuts it: the reference for water."""

import numpy as np
import trimesh
from meshes import fans

from balloon_warp.mesh import PolygonMesh


def wet_part(mesh: PolygonMesh, level: float) -> trimesh.Trimesh:
    """Return the part below the level that trimesh cuts off, open at the cut."""
    solid = fans(mesh)
    points, triangles, _ = trimesh.intersections.slice_faces_plane(
        solid.vertices, solid.faces, plane_normal=np.array([0, -1, 0]), plane_origin=np.array([0, level, 0])
    )
    return trimesh.Trimesh(points, triangles, process=False)


def displaced(mesh: PolygonMesh, level: float) -> tuple[float, np.ndarray]:
    """Return the volume below the level, and its center: from a point on the surface the open cut has no volume."""
    wet = wet_part(mesh, level)
    wet.apply_translation([0.0, -level, 0.0])
    return wet.volume, wet.center_mass + [0.0, level, 0.0]

"""The signed distance to a surface in a grid of cells, whose zero level a remeshed surface is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import triangulate
from balloon_warp.mesh.mesh_distance import MeshDistance
from balloon_warp.mesh.orientation import oriented_outward
from balloon_warp.mesh.polygon_mesh import PolygonMesh


@dataclass(frozen=True)
class Level:
    """A distance in cells, about the middle of a surface: Warp measures in float32."""

    distance: MeshDistance
    reach: NDArray[np.float64]
    """Half the box of the level, in cells, shape (3,)"""
    middle: NDArray[np.float64]
    """Center of the surface, in its unit, shape (3,)"""
    cell: float
    """Width of a cell, in the surface's unit"""

    @classmethod
    def of(cls, mesh: PolygonMesh, cells: int) -> "Level":
        """Return the level of a surface whose longest side has so many cells."""
        used = mesh.points[np.unique(mesh.face_vertex_indices)]
        lower, upper = used.min(axis=0), used.max(axis=0)
        middle, cell = 0.5 * (lower + upper), cls.width(mesh, cells)
        triangles, _ = triangulate(oriented_outward(mesh))
        distance = MeshDistance((mesh.points - middle) / cell, triangles, thickness=1.0)
        # Half of a slab and its blend stand out of the box.
        return cls(distance, 0.5 * (upper - lower) / cell + 2.0, middle, cell)

    @staticmethod
    def width(mesh: PolygonMesh, cells: int) -> float:
        """Return the width of a cell."""
        return float(np.ptp(mesh.points[mesh.face_vertex_indices], axis=0).max()) / cells

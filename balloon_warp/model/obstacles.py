"""Obstacles on the host: their shapes, and how they move from frame to frame."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.check import check_mesh
from balloon_warp.mesh.geometry import signed_volume, triangulate
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.placement import place_mesh
from balloon_warp.mesh.prepare import Treatment, prepared
from balloon_warp.mesh.topology import is_closed, mesh_edges
from balloon_warp.mesh.units import as_told
from balloon_warp.scene import Body, Obstacle, Scene

SHEET = 1.0e-3
"""Thickness of a sheet over its size"""
FAINT = 4.0e-6
"""Resolution of float32 between two distances, over a mesh's size"""
BLURS = (1.0e-6, 1.0e-3)
"""Least and largest blur, over the mean edge; the largest is Warp's own"""


@dataclass(frozen=True)
class ObstacleShape:
    """An obstacle about its own origin, not turned."""

    kind: str
    size: NDArray[np.float64]
    """Half the edges of a box; radius, half the length and 0 of a capsule; zeros for others [m], shape (3,)"""
    mesh: PolygonMesh | None
    """Mesh in meters, in the scene's up axis"""
    closed: bool
    """Whether the mesh has an inside; one that winds inward is a room, whose walls are sheets"""
    thickness: float
    """Distance from the surface at which particles are held [m]"""
    reach: float
    """Distance of the farthest point from the origin, with the thickness [m]; infinite for a plane"""
    remarks: tuple[str, ...] = ()
    """Remarks on the reading of the mesh's file, a sentence each"""

    @property
    def triangles(self) -> NDArray[np.int32]:
        """Triangles of the mesh, shape (n, 3)."""
        return triangulate(self.mesh)[0] if self.mesh else np.zeros((0, 3), dtype=np.int32)

    @property
    def blur(self) -> float:
        """Resolution of float32 between distances from a point to two places of the mesh, over the mean edge."""
        if self.mesh is None:
            return 0.0
        corners = self.mesh.points[self.triangles]
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        return float(np.clip(FAINT * self.reach / edges.mean(), *BLURS))


def shape_obstacle(number: int, obstacle: Obstacle | Body, scene: Scene) -> ObstacleShape:
    """Read the mesh of an obstacle, or of a body, and measure it.

    Raises:
        InputError: the mesh cannot be read, or has no face or no size.
    """
    mesh, closed, size, reach, remarks = None, True, np.zeros(3), np.inf, ()
    if obstacle.shape == "box":
        size = 0.5 * np.array(obstacle.size)
        reach = float(np.linalg.norm(size))
    elif obstacle.shape == "capsule":
        size = np.array([obstacle.radius, 0.5 * obstacle.length, 0.0])
        reach = float(size.sum())
    elif obstacle.shape == "mesh":
        assert obstacle.mesh is not None  # as the schema sees to
        source = str(obstacle.mesh) if isinstance(obstacle.mesh, Path) else obstacle.mesh.name
        mesh = load_mesh(obstacle.mesh, obstacle.prim)
        check_mesh(mesh, source)
        remarks = tuple(f"{source}: {warning}" for warning in mesh.warnings)
        winds_inward = signed_volume(mesh) < 0.0
        mesh = prepared(mesh, source, Treatment(holes="keep", parts="free"))
        mesh = place_mesh(as_told(mesh, obstacle.unit, obstacle.up), scene.up_axis, obstacle.scale)
        closed = is_closed(mesh_edges(mesh)) and not (winds_inward and isinstance(obstacle, Obstacle))
        used = mesh.points[np.unique(mesh.face_vertex_indices)]
        reach = float(np.linalg.norm(used, axis=1).max())
        if np.ptp(used, axis=0).max() == 0.0:
            raise InputError(f"{source}: all vertices coincide; expected a mesh with an extent")
    thickness = obstacle.thickness
    if thickness is None:
        thickness = 0.0 if closed else SHEET * reach
    return ObstacleShape(obstacle.shape, size, mesh, closed, thickness, reach + thickness, remarks)


def warp_mesh(shape: ObstacleShape, device: wp.Device) -> wp.Mesh | None:
    """Make the Warp mesh in which kernels find the nearest place."""
    if shape.mesh is None:
        return None
    points = wp.array(shape.mesh.points, dtype=wp.vec3, device=device)
    return wp.Mesh(points, wp.array(shape.triangles.ravel(), dtype=wp.int32, device=device))

"""Hinges: the edges between two faces, across which torsion springs keep an angle."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.corners import corner_faces, face_starts
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import mesh_edges


@dataclass(frozen=True)
class Hinges:
    """Hinges: the edges of exactly two faces.

    A face's wing is its corners beside the edge; their mean represents the face.
    """

    ends: NDArray[np.int64]
    """Particles of each edge, the lower first, shape (hinge_count, 2)"""
    wing_offsets: NDArray[np.int64]
    """Begin of hinge n's wings at entries 2 n and 2 n + 1, shape (2 hinge_count + 1,)"""
    wing_particles: NDArray[np.int64]
    """Corners of all wings"""

    @property
    def count(self) -> int:
        return len(self.ends)

    @property
    def wing_sizes(self) -> NDArray[np.int64]:
        """Number of corners of each wing, shape (hinge_count, 2)."""
        return np.diff(self.wing_offsets).reshape(-1, 2)

    def arms(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return the edge, and from its first end the first and the second wing, each of shape (hinge_count, 3)."""
        sums = np.add.reduceat(points[self.wing_particles], self.wing_offsets[:-1], axis=0).reshape(-1, 2, 3)
        wings = sums / self.wing_sizes[..., None] - points[self.ends[:, :1]]
        return points[self.ends[:, 1]] - points[self.ends[:, 0]], wings[:, 0], wings[:, 1]

    def angles(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the angle from the first face's normal to the second's about each edge [rad], shape (hinge_count,)."""
        edge, first, second = self.arms(points)
        normals = np.cross(edge, first), np.cross(second, edge)
        lengths = np.linalg.norm(edge, axis=1)
        return np.arctan2((np.cross(*normals) * edge).sum(axis=1) / lengths, (normals[0] * normals[1]).sum(axis=1))

    def gradients(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the gradients of the angles by the edges' ends and the wings [rad/m], shape (hinge_count, 4)."""
        edge, *wings = self.arms(points)
        lengths = np.maximum(np.linalg.norm(edge, axis=1), 1e-12)
        of_wings, of_ends = [], np.zeros((self.count, 2, 3))
        for wing in wings:
            normal = np.cross(edge, wing)
            gradient = normal * (lengths / np.maximum((normal**2).sum(axis=1), 1e-20))[:, None]
            along = ((wing * edge).sum(axis=1) / lengths**2)[:, None]
            sign = 1.0 if not of_wings else -1.0  # the wings are on either side
            of_ends -= sign * np.stack([(1.0 - along) * gradient, along * gradient], axis=1)
            of_wings.append(np.linalg.norm(gradient, axis=1))
        return np.stack([*np.linalg.norm(of_ends, axis=2).T, *of_wings], axis=1)


def build_hinges(mesh: PolygonMesh) -> Hinges:
    """Return the hinges of a mesh, in the order of their ends; none at borders and where more than two faces meet."""
    edges, starts, faces = mesh_edges(mesh), face_starts(mesh), corner_faces(mesh)
    ends, wings = [], []
    for edge in np.flatnonzero(edges.face_counts == 2).tolist():
        pair = edges.ends[edge]
        both = [
            mesh.face_vertex_indices[starts[face] : starts[face] + mesh.face_vertex_counts[face]]
            for face in faces[edges.corners[edges.starts[edge] : edges.starts[edge] + 2]].tolist()
        ]
        beside = [corners[(corners != pair[0]) & (corners != pair[1])] for corners in both]
        if len(beside[0]) and len(beside[1]):
            ends.append(pair)
            wings.extend(beside)
    sizes = [len(wing) for wing in wings]
    return Hinges(
        ends=np.array(ends, dtype=np.int64).reshape(-1, 2),
        wing_offsets=np.cumsum([0, *sizes]),
        wing_particles=np.concatenate([np.zeros(0, dtype=np.int64), *wings]).astype(np.int64),
    )

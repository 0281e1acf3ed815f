"""The triangles that a membrane is stretched over: of quads and polygons so many that no diagonal is preferred."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import face_starts

MOST_FANS = 6
"""Largest number of fans that cover a face of more corners"""
LEAST_AREA = 1.0e-6
"""Least area of a triangle over its squared longest edge; smaller ones are left out"""


@dataclass(frozen=True)
class Membrane:
    """Triangles that together cover each face once, with its whole thickness."""

    corners: NDArray[np.int64]
    """Corners, shape (T, 3)"""
    areas: NDArray[np.float64]
    """Rest areas, times the triangle's share in covering the face [m^2], shape (T,)"""
    edges: NDArray[np.float64]
    """Rest edges from the first corner to the others [m], shape (T, 2, 3)"""
    faces: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """Face that each covers a part of, shape (T,)"""
    cut: float = 0.0
    """Part by which rest edges are shorter than those of the mesh; areas, and so mass, are not smaller"""

    @property
    def count(self) -> int:
        """Number of triangles."""
        return len(self.corners)

    def turned(self, turns: int) -> "Membrane":
        """Return the triangles with another corner first."""
        ends = np.concatenate([np.zeros((self.count, 1, 3)), self.edges], axis=1)
        ends = np.roll(ends, -turns, axis=1)
        return Membrane(np.roll(self.corners, -turns, axis=1), self.areas, ends[:, 1:] - ends[:, :1])

    @property
    def rests(self) -> NDArray[np.float64]:
        """Components 11, 12 and 22 of the inverse rest metric [1/m^2], and the area [m^2], shape (T, 4)."""
        first, second = self.edges[:, 0], self.edges[:, 1]
        squares, product = ((first**2).sum(axis=1), (second**2).sum(axis=1)), (first * second).sum(axis=1)
        determinant = (np.cross(first, second) ** 2).sum(axis=1)
        return np.stack(
            [squares[1] / determinant, -product / determinant, squares[0] / determinant, self.areas], axis=1
        )

    def cut_by(self, part: float) -> "Membrane":
        """Return the triangles with rest edges that are shorter by a part than those of the mesh."""
        return replace(self, edges=self.edges * ((1.0 - part) / (1.0 - self.cut)), cut=part)

    def part(self, rows: NDArray[np.integer]) -> "Membrane":
        """Return some of the triangles."""
        faces = self.faces[rows] if len(self.faces) else self.faces
        return Membrane(self.corners[rows], self.areas[rows], self.edges[rows], faces)

    @property
    def quad_rows(self) -> NDArray[np.int64]:
        """Rows of the triangles of those quads that have all four, shape (Q, 4).

        They are (a, b, c), (a, b, d), (a, c, d) and (b, c, d).
        """
        first, second, third, fourth = (self.corners[k : self.count - 3 + k] for k in range(4))
        a, b, c, d = first[:, 0], first[:, 1], first[:, 2], second[:, 2]
        matches = np.ones(len(first), dtype=bool)
        for triangle, corners in ((second, (a, b, d)), (third, (a, c, d)), (fourth, (b, c, d))):
            matches &= (triangle == np.stack(corners, axis=1)).all(axis=1)
        begins: list[int] = []
        for row in np.flatnonzero(matches).tolist():  # those of polygons may overlap
            if not begins or row >= begins[-1] + 4:
                begins.append(row)
        return np.array(begins, dtype=np.int64).reshape(-1, 1) + np.arange(4)

    @property
    def laplacian(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Pairs of particles, shape (3 T, 2), and their cotangent weights, shape (3 T,).

        Weights are half cotangents times the share of the triangle: the squared gradient of a function linear in each
        triangle, over its area, is the sum of the squared differences times these.
        """
        g11, g12, g22, area = self.rests.T
        between = np.stack([g11 + g12, g22 + g12, -g12], axis=1) * area[:, None]
        pairs = self.corners[:, [[0, 1], [0, 2], [1, 2]]]
        return pairs.reshape(-1, 2), between.ravel()

    def stretches(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the larger principal stretch of each triangle where its corners are at these points, shape (T,)."""
        places = np.asarray(points, dtype=np.float64)[self.corners]
        edges = places[:, 1:] - places[:, :1]
        g11, g12, g22, _ = self.rests.T
        m11, m12, m22 = (np.einsum("ij,ij->i", edges[:, k], edges[:, m]) for k, m in ((0, 0), (0, 1), (1, 1)))
        first, second = g11 * m11 + g12 * m12, g12 * m12 + g22 * m22
        across = (g11 * m12 + g12 * m22) * (g12 * m11 + g22 * m12)
        spread = np.sqrt(np.maximum((first - second) ** 2 + 4.0 * across, 0.0))
        return np.sqrt(0.5 * (first + second + spread))

    def lumps(self, count: int) -> NDArray[np.float64]:
        """Return the area that falls to each of so many particles [m^2]."""
        lumps = np.zeros(count)
        np.add.at(lumps, self.corners, self.areas[:, None] / 3.0)
        return lumps


def no_membrane() -> Membrane:
    """Return an empty membrane."""
    return Membrane(np.zeros((0, 3), dtype=np.int64), np.zeros(0), np.zeros((0, 2, 3)))


def build_membrane(mesh: PolygonMesh) -> Membrane:
    """Return the membrane of a mesh: each face is the mean of its fans of triangles, one from each corner.

    A quad has so its four corner triangles, each by half; a face of many corners has fans from a few.

    A face of two corners has none, and neither has one no wider than a line.
    """
    starts, corners, parts = face_starts(mesh), [np.zeros((0, 3), dtype=np.int64)], [np.zeros(0)]
    faces = [np.zeros(0, dtype=np.int64)]
    for size in np.unique(mesh.face_vertex_counts[mesh.face_vertex_counts > 2]).tolist():
        places, weights = _fans(size)
        firsts = starts[mesh.face_vertex_counts == size]
        of_faces = mesh.face_vertex_indices[firsts[:, None, None] + places].astype(np.int64)
        corners.append(of_faces.reshape(-1, 3))
        parts.append(np.tile(weights, len(firsts)))
        faces.append(np.repeat(np.flatnonzero(mesh.face_vertex_counts == size), len(weights)))
    triangles = np.concatenate(corners)
    points = mesh.points[triangles]
    edges = points[:, 1:] - points[:, :1]
    double_areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    longest = np.maximum((edges**2).sum(axis=2).max(axis=1), ((edges[:, 1] - edges[:, 0]) ** 2).sum(axis=1))
    wide = 0.5 * double_areas > LEAST_AREA * longest
    areas = 0.5 * double_areas * np.concatenate(parts)
    return Membrane(triangles[wide], areas[wide], edges[wide], np.concatenate(faces)[wide])


def _fans(size: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the triangles of a face's fans, each once, shape (T, 3), and the fraction of the fans that have it.

    Triangles are given by the places of their corners in the face.
    """
    tips = np.unique(np.linspace(0, size, min(size, MOST_FANS), endpoint=False).astype(np.int64))
    found = [sorted((tip, (tip + k) % size, (tip + k + 1) % size)) for tip in tips.tolist() for k in range(1, size - 1)]
    places, counts = np.unique(np.array(found), axis=0, return_counts=True)
    return places, counts / len(tips)

"""Gaps that a mould must keep: between sides that face each other, and across its triangles."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.spatial import KDTree

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import vertex_normals

Values = NDArray[np.float64]
FACING = -0.2
"""Largest product of the normals of vertices that face each other"""
REACH, ASIDE = 3.2, 1.0
"""Largest distance of a pair, and across the gap, over the edge"""
OUTSIDE, INSIDE = 0.7, 0.3
"""Least gap between two parts, and least thickness of one, over the edge"""
FLATTEST, TOO_FLAT = 0.25, 0.1
"""Least altitude of a triangle that steps aim at, and that they may leave, over the one in the plain mould"""
PUSHED, FIRMLY = 9.0, 900.0
"""Weights of missing gaps over that of errors, squared: between sides, and of altitudes, which are a tenth as large"""


@dataclass(frozen=True)
class Gaps:
    """Gaps as functions of the vertices."""

    widths: Values
    """Widths [m], shape (k,)"""
    least: Values
    """Wanted least widths [m], shape (k,)"""
    widening: Any
    """Derivatives of the widths by the vertices' coordinates, shape (k, 3 n)"""
    weights: Values
    """Weights of missing widths, squared, over those of errors, shape (k,)"""

    @classmethod
    def of(cls, mould: PolygonMesh, plain: PolygonMesh, triangles: NDArray[np.int64], edge: float) -> "Gaps":
        """Find the gaps of a mould that does not cross itself.

        Args:
            plain: Mould that is the scaled-down target shape.
            triangles: Corners of the film's triangles, shape (t, 3).
            edge: Mean length of its edges [m].
        """
        facing, across = _facing(mould, edge), _altitudes(mould, plain, triangles)
        return cls(
            np.concatenate([facing[0], across[0]]),
            np.concatenate([facing[1], FLATTEST * across[1]]),
            sparse.vstack([facing[2], across[2]]).tocsr(),
            np.repeat([PUSHED, FIRMLY], [len(facing[0]), len(across[0])]),
        )


@dataclass(frozen=True)
class Flattening:
    """Triangles of a mould that changes flatten too much."""

    mould: PolygonMesh
    plain: PolygonMesh
    triangles: NDArray[np.int64]
    """Corners of the film's triangles, shape (t, 3)"""

    def vertices(self, points: Values) -> NDArray[np.int64]:
        """Return the vertices of the triangles that are flatter than they may be, and than in the mould."""
        before, wanted, _ = _altitudes(self.mould, self.plain, self.triangles)
        after = _altitudes(replace(self.mould, points=points), self.plain, self.triangles)[0]
        flat = (after < TOO_FLAT * wanted) & (after < before)
        return np.unique(self.triangles[flat])


def _facing(mesh: PolygonMesh, edge: float) -> tuple[Values, Values, Any]:
    """Return the gaps between vertices that face each other, from outside or through the inside."""
    points, normals = mesh.points, vertex_normals(mesh)
    pairs = KDTree(points).query_pairs(REACH * edge, output_type="ndarray").astype(np.int64)
    pairs = pairs[(normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1) < FACING]
    ways = normals[pairs[:, 0]] - normals[pairs[:, 1]]
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    apart = points[pairs[:, 1]] - points[pairs[:, 0]]
    widths = (apart * ways).sum(axis=1)
    near = np.linalg.norm(apart - widths[:, None] * ways, axis=1) < ASIDE * edge
    pairs, ways, widths = pairs[near], ways[near], widths[near]
    ways *= np.where(widths > 0.0, 1.0, -1.0)[:, None]
    least = edge * np.where(widths > 0.0, OUTSIDE, INSIDE)
    return np.abs(widths), least, _rows(pairs, np.stack([-ways, ways], axis=1), len(points))


def _altitudes(mould: PolygonMesh, plain: PolygonMesh, triangles: NDArray[np.int64]) -> tuple[Values, Values, Any]:
    """Return the triangles' least altitudes, and those in the plain mould."""
    corners = _tips_first(triangles, mould.points)
    widths, ways, along = _altitudes_of(mould.points[corners])
    of_corners = np.stack([np.ones(len(along)), along - 1.0, -along], axis=1)
    wanted = _altitudes_of(plain.points[_tips_first(triangles, plain.points)])[0]
    return widths, wanted, _rows(corners, of_corners[:, :, None] * ways[:, None], len(mould.points))


def _tips_first(triangles: NDArray[np.int64], points: Values) -> NDArray[np.int64]:
    """Return the corners of triangles, those that face the longest edge first, shape (t, 3)."""
    places = points[triangles]
    opposite = np.linalg.norm(np.roll(places, -1, axis=1) - np.roll(places, -2, axis=1), axis=2)
    order = (opposite.argmax(axis=1)[:, None] + np.arange(3)) % 3
    return np.take_along_axis(triangles, order, axis=1)


def _altitudes_of(places: Values) -> tuple[Values, Values, Values]:
    """Return the altitudes on the first corners, shape (t,), their ways, and where along the edge they stand."""
    side, base = places[:, 0] - places[:, 1], places[:, 2] - places[:, 1]
    along = (side * base).sum(axis=1) / np.maximum((base * base).sum(axis=1), 1.0e-300)
    ways = side - along[:, None] * base
    widths = np.linalg.norm(ways, axis=1)
    return widths, ways / np.maximum(widths, 1.0e-300)[:, None], along


def _rows(vertices: NDArray[np.int64], vectors: Values, count: int) -> Any:
    """Return a matrix whose rows have a vector for each of their vertices, shape (k, 3 count)."""
    columns = 3 * vertices[:, :, None] + np.arange(3)
    rows = np.broadcast_to(np.arange(len(vertices))[:, None, None], columns.shape)
    shape = (len(vertices), 3 * count)
    return sparse.csr_matrix((vectors.ravel(), (rows.ravel(), columns.ravel())), shape=shape)

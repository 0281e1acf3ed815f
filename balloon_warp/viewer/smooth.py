"""A finer surface for the eye: one step of Catmull and Clark (1978), a matrix that is made once."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix, vstack

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import triangulate
from balloon_warp.model import Model

MOST_PARTICLES = 5000
"""Largest number of particles of all balloons for smooth surfaces: a finer surface has four times as many points to
send"""


class Plain:
    """A mesh as it is.

    Args:
        mesh: of a balloon.
    """

    def __init__(self, mesh: PolygonMesh):
        self.triangles, self.triangle_faces = triangulate(mesh)
        corners = np.arange(len(mesh.face_vertex_indices))
        self._corners, _ = triangulate(replace(mesh, face_vertex_indices=corners, texture_coordinates=None))

    def points(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the points of the mesh."""
        return points

    def spread(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values at the corners of the triangles from those of the mesh's faces.

        Args:
            values: Values, shape (corner_count, k).

        Returns:
            Shape (n, 3, k).
        """
        return values[self._corners]


def surfaces_of(model: Model) -> "list[Plain | Smooth]":
    """Return the surface to draw of each balloon: smooth, unless that would be too much to send."""
    kind = Smooth if model.particle_count <= MOST_PARTICLES else Plain
    return [kind(shape.mesh) for shape in model.shapes]


class Smooth:
    """A mesh whose faces are split into a quad for each corner, and its points moved to a smooth surface.

    Args:
        mesh: of a balloon; open borders keep their course.
    """

    def __init__(self, mesh: PolygonMesh):
        counts, corners = np.asarray(mesh.face_vertex_counts), np.asarray(mesh.face_vertex_indices, dtype=np.int64)
        faces = np.repeat(np.arange(len(counts)), counts)
        firsts = np.repeat(np.cumsum(counts) - counts, counts)
        number = np.arange(len(corners)) - firsts
        after = firsts + (number + 1) % counts[faces]
        following = corners[after]
        pairs = np.sort(np.stack([corners, following], axis=1), axis=1)
        ends, edges, uses = np.unique(pairs, axis=0, return_inverse=True, return_counts=True)
        edges = edges.reshape(-1)
        before = edges[firsts + (number - 1) % counts[faces]]
        n_points, n_edges = mesh.vertex_count, len(ends)
        centers = _rows(faces, corners, 1.0 / counts[faces], (len(counts), n_points))
        middles = _rows(np.repeat(np.arange(n_edges), 2), ends.ravel(), np.full(2 * n_edges, 0.5), (n_edges, n_points))
        inner = uses == 2
        beside = _rows(edges, faces, np.full(len(edges), 0.5), (n_edges, len(counts)))
        smooth_edges = middles - _scaled(0.5 * inner, middles - beside @ centers)
        smooth_points = _points(corners, faces, ends, inner, (centers, middles), n_points)
        self._matrix: Any = vstack([smooth_points, smooth_edges, centers]).tocsr().astype(np.float32)
        quads = np.stack([corners, n_points + edges, n_points + n_edges + faces, n_points + before], axis=1)
        self.triangles = quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
        """Triangles of the finer surface, shape (n, 3)"""
        self.triangle_faces = np.repeat(faces, 2)
        """Face of the mesh of each triangle, shape (n,)"""
        self._beside = after, firsts + (number - 1) % counts[faces]
        """Next and previous corner of each corner in its face"""
        self._means = _rows(faces, np.arange(len(corners)), 1.0 / counts[faces], (len(counts), len(corners)))

    def points(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the points of the finer surface from those of the mesh; shape (n, 3)."""
        return self._matrix @ points

    def spread(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values at the corners of the triangles from those of the mesh's faces.

        They are interpolated linearly, so that an image is cut where the mesh cuts it.

        Args:
            values: Values, shape (corner_count, k).

        Returns:
            Shape (n, 3, k).
        """
        after, before = self._beside
        centers = np.repeat(self._means @ values, np.diff(self._means.indptr), axis=0)
        quads = [values, (values + values[after]) / 2, centers, (values + values[before]) / 2]
        return np.stack(quads, axis=1)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3, values.shape[1])


def _points(
    corners: NDArray[np.int64],
    faces: NDArray[np.int64],
    ends: NDArray[np.int64],
    inner: NDArray[np.bool_],
    means: tuple[Any, Any],
    count: int,
) -> Any:
    """Return the matrix rows for the mesh's own points (Catmull-Clark).

    (mean of faces + 2 mean of edges + (n - 3) point) / n, n the edges there; on a border half the point, and half the
    mean of the border's two edges there.
    """
    centers, middles = means
    here = ends.ravel()
    at_edges = np.repeat(np.arange(len(ends)), 2)
    valence = np.maximum(np.bincount(here, minlength=count), 1)
    around = np.maximum(np.bincount(corners, minlength=count), 1)
    faces_mean = _rows(corners, faces, 1.0 / around[corners], (count, centers.shape[0]))
    edges_mean = _rows(here, at_edges, 1.0 / valence[here], (count, len(ends)))
    alone = _rows(np.arange(count), np.arange(count), np.ones(count), (count, count))
    inside = _scaled(1.0 / valence, faces_mean @ centers + 2.0 * (edges_mean @ middles))
    inside = inside + _scaled((valence - 3.0) / valence, alone)
    border = ~inner[at_edges]
    borders = np.bincount(here[border], minlength=count)
    rim = _rows(here[border], at_edges[border], 0.5 / borders[here[border]], (count, len(ends)))
    on_border = _scaled((borders > 0) * 0.5, alone) + rim @ middles
    kept = (borders == 0) & (np.bincount(corners, minlength=count) > 0)
    nowhere = (borders == 0) & ~kept
    return _scaled(1.0 * kept, inside) + _scaled(1.0 * (borders > 0), on_border) + _scaled(1.0 * nowhere, alone)


def _rows(rows: Any, columns: Any, values: Any, shape: tuple[int, int]) -> Any:
    return coo_matrix((values, (rows, columns)), shape=shape).tocsr()


def _scaled(factors: NDArray[np.floating], matrix: Any) -> Any:
    """Return a matrix, each row times a factor."""
    return csr_matrix(matrix.multiply(np.asarray(factors, dtype=np.float64)[:, None]))

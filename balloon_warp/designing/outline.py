"""Foil: the flat outline of two sheets, sewn at the rim, that has the wanted outline once it is inflated.

Foil hardly stretches: as the sheets part, the rim is drawn in, and wrinkles; a circle's to 0.763 of its radius. The
error of the rim is fed back to the pattern, a few times, and the sheets follow it.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from balloon_warp.designing.measure import Error, aligned
from balloon_warp.foil.grid import border_loops
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import mesh_edges

Values = NDArray[np.float64]
SMOOTH = np.array([1.0, 2.0, 3.0, 2.0, 1.0]) / 9.0
"""Smoothing kernel along the rim: wrinkles are no part of its shape"""


@dataclass(frozen=True)
class Part:
    """Flat balloon: two sheets with a common rim."""

    mesh: PolygonMesh
    """Flat mesh of the target, inflated outline"""

    @cached_property
    def loops(self) -> list[NDArray[np.int64]]:
        """The rim's vertices in order: around, and around each hole."""
        quads = self.mesh.face_vertex_indices.reshape(-1, 4)
        front = quads[(self.mesh.points[quads][:, :, 2] >= 0.0).all(axis=1)]
        return border_loops(front.astype(np.int64))

    @cached_property
    def rim(self) -> NDArray[np.int64]:
        """Vertices of the rim, loop by loop."""
        return np.concatenate(self.loops)

    @property
    def wanted(self) -> Values:
        """Target places of the rim, shape (r, 2)."""
        return self.mesh.points[self.rim, :2]

    def rim_of(self, points: Values) -> Values:
        """Return the rim of inflated points, smooth and laid onto the wanted one, shape (r, 2)."""
        flat = np.concatenate([_smoothed(points[loop]) for loop in self.loops])
        goal = np.concatenate([self.wanted, np.zeros((len(self.rim), 1))], axis=1)
        return aligned(flat, goal)[:, :2]

    def error(self, rim: Values, size: float) -> Error:
        """Return the distance of an inflated rim from the target outline, over the size."""
        off, begin = [], 0
        for loop in self.loops:
            own = slice(begin, begin + len(loop))
            off += [_to_line(rim[own], self.wanted[own]), _to_line(self.wanted[own], rim[own])]
            begin += len(loop)
        distances = np.concatenate(off) / size
        return Error(float(distances.mean()), float(distances.max()))

    def with_rim(self, rim: Values) -> PolygonMesh:
        """Return the flat mesh with its rim there, shape (r, 2); the sheets follow evenly."""
        moves = rim - self.wanted
        inner = np.setdiff1d(np.arange(self.mesh.vertex_count), self.rim)
        points = self.mesh.points.copy()
        points[self.rim, :2] += moves
        points[inner, :2] += self._harmonic(inner) @ moves
        return replace(self.mesh, points=points)

    def _harmonic(self, inner: NDArray[np.int64]) -> Values:
        """Return the harmonic extension of rim displacements to the other vertices, shape (i, r)."""
        ends, count = mesh_edges(self.mesh).ends, self.mesh.vertex_count
        ones = np.ones(len(ends))
        beside = sparse.coo_matrix((ones, (ends[:, 0], ends[:, 1])), shape=(count, count))
        beside = (beside + beside.T).tocsr()
        laplacian = (sparse.diags(np.asarray(beside.sum(axis=1)).ravel()) - beside).tocsc()
        return -splu(laplacian[inner][:, inner].tocsc()).solve(laplacian[inner][:, self.rim].toarray())


def corrected(part: Part, pattern: Values, rim: Values) -> Values:
    """Return the rim of the next pattern, corrected by the error of an inflated rim, smoothed along the rim."""
    missing, begin, next_ = part.wanted - rim, 0, pattern.copy()
    for loop in part.loops:
        own = slice(begin, begin + len(loop))
        next_[own] += _smoothed(missing[own])
        begin += len(loop)
    return next_


def _smoothed(places: Values) -> Values:
    """Return each place of a closed line as the mean of those around it, less the shrinking of that."""
    once = _mean_around(places)
    return once + (once - _mean_around(once))  # as far as a circle is drawn in by the mean, it is put out again


def _mean_around(places: Values) -> Values:
    half = len(SMOOTH) // 2
    shifted = [np.roll(places, shift, axis=0) for shift in range(-half, half + 1)]
    return np.tensordot(SMOOTH, np.stack(shifted), axes=1)


def _to_line(places: Values, line: Values) -> Values:
    """Return the distances of places from a closed line, shape (n,)."""
    begin, end = line, np.roll(line, -1, axis=0)
    way = end - begin
    along = ((places[:, None] - begin) * way).sum(axis=2) / np.maximum((way**2).sum(axis=1), 1e-30)
    nearest = begin + np.clip(along, 0.0, 1.0)[:, :, None] * way
    return np.linalg.norm(places[:, None] - nearest, axis=2).min(axis=1)

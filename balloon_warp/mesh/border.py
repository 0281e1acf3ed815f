"""Open edges of a mesh, and which of them lie along each other."""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.corners import corner_faces
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import border_edges, mesh_edges

BESIDE = 8
"""Number of nearest edges considered for each edge"""
ACROSS = 0.4
"""Largest gap across a seam over an edge's length; beyond it an edge's neighbors are as near"""


class Pairs(NamedTuple):
    """Open edges that lie along each other, from end to end."""

    edges: NDArray[np.int64]
    """Numbers of two edges each, shape (n, 2)"""
    ends: NDArray[np.int64]
    """Vertices of both edges that lie beside each other, shape (n, 2, 2)"""
    gaps: NDArray[np.float64]
    """Larger of the two gaps, shape (n,)"""


@dataclass(frozen=True)
class Border:
    """The open edges of a mesh."""

    points: NDArray[np.float64]
    """Points of the mesh, shape (vertex_count, 3)"""
    ends: NDArray[np.int64]
    """Vertices of border edges, shape (n, 2)"""
    faces: NDArray[np.int64]
    """Faces of border edges, shape (n,)"""

    @classmethod
    def of(cls, mesh: PolygonMesh) -> Self:
        """Collect a mesh's open edges; each of its faces has its corners once."""
        edges = mesh_edges(mesh)
        border = border_edges(edges)
        return cls(mesh.points, edges.ends[border], corner_faces(mesh)[edges.corners[edges.starts[border]]])

    @property
    def lengths(self) -> NDArray[np.float64]:
        """Lengths of the edges, shape (n,)."""
        begin, end = np.moveaxis(self.points[self.ends], 1, 0)
        return np.linalg.norm(end - begin, axis=1)

    def pairs(self, reach: float, alike: float = 0.0, across: float = ACROSS) -> Pairs:
        """Find edges that lie along each other, of different faces.

        Args:
            reach: the widest gap.
            alike: up to this gap any two are a pair; with a wider one, two of which each is the other's nearest.
            across: of an edge's length is a gap at most.
        """
        count, lengths = len(self.ends), self.lengths
        bound = min(reach, across * lengths.max(initial=0.0))
        if count < 2 or not bound:
            return Pairs(np.zeros((0, 2), np.int64), np.zeros((0, 2, 2), np.int64), np.zeros(0))
        from scipy.spatial import KDTree  # takes long to load: only for open meshes

        middles = self.points[self.ends].mean(axis=1)
        found = KDTree(middles).query(middles, k=min(BESIDE, count), distance_upper_bound=np.nextafter(bound, np.inf))
        others = np.asarray(found[1])
        first, slot = np.nonzero(others < count)
        second = others[first, slot]
        straight, crossed = self._gaps(self.ends[second], first), self._gaps(self.ends[second, ::-1], first)
        gaps = np.minimum(straight, crossed)
        near = (gaps <= np.minimum(reach, across * np.minimum(lengths[first], lengths[second]))) & (
            self.faces[first] != self.faces[second]
        )
        first, second, gaps, turned = first[near], second[near], gaps[near], (crossed < straight)[near]
        nearest = np.full(count, -1)
        order = np.argsort(-gaps, kind="stable")
        nearest[first[order]] = second[order]
        taken = (gaps <= alike) | ((nearest[first] == second) & (nearest[second] == first))
        first, second, turned = first[taken], second[taken], turned[taken]
        other = np.where(turned[:, None], self.ends[second, ::-1], self.ends[second])
        return Pairs(np.stack([first, second], axis=1), np.stack([self.ends[first], other], axis=2), gaps[taken])

    def _gaps(self, others: NDArray[np.int64], edges: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the larger distance between the ends of each edge and of another, shape (n,)."""
        return np.linalg.norm(self.points[self.ends[edges]] - self.points[others], axis=2).max(axis=1, initial=0.0)

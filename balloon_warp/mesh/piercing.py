"""Edges of a surface that go through its faces."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import first_coincident

ROUNDING = 1e-6
"""Depth that is none, over the size of the surface"""
ROWS = 2048
"""Number of triangles whose surroundings are looked at together, to bound the memory"""


class Piercings(NamedTuple):
    """Edges that go through triangles."""

    edges: NDArray[np.int64]
    """Ends of each edge, shape (n, 2)"""
    triangles: NDArray[np.int64]
    """Number of the triangle that it goes through, shape (n,)"""
    depths: NDArray[np.float64]
    """Distance of the nearer end from the plane of the triangle [m], shape (n,)"""
    places: NDArray[np.float64]
    """Position [m], shape (n, 3)"""


def find_piercings(points: NDArray[np.float64], triangles: NDArray[np.integer]) -> Piercings:
    """Return the edges that go through triangles with which they share no corner; corners at one place are one.

    Two triangles that cross have such an edge: of the one or of the other.
    """
    from scipy.spatial import KDTree  # takes long to load

    same = first_coincident(points)
    corners = same[triangles]
    sides = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    edges = np.unique(sides[sides[:, 0] != sides[:, 1]], axis=0)
    found = [Piercings(edges[:0], np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 3)))]
    if len(edges):
        middles, halves = points[edges].mean(axis=1), np.linalg.norm(np.diff(points[edges], axis=1)[:, 0], axis=1) / 2.0
        centers = points[triangles].mean(axis=1)
        radii = np.linalg.norm(points[triangles] - centers[:, None], axis=2).max(axis=1) + halves.max()
        tree, normals = KDTree(middles), _normals(points[triangles])
        least = ROUNDING * float(np.ptp(points[edges].reshape(-1, 3), axis=0).max())
        for first in range(0, len(triangles), ROWS):
            rows = slice(first, first + ROWS)
            near = tree.query_ball_point(centers[rows], radii[rows])
            numbers = np.repeat(np.arange(first, first + len(near)), [len(each) for each in near])
            beside = edges[np.concatenate([np.asarray(each, np.int64) for each in near])]
            found.append(_piercing(points, beside, corners, normals, numbers, least))
    return Piercings(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _normals(ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit normals of triangles, shape (n, 3); zeros for those of no area."""
    normals = np.cross(ends[:, 1] - ends[:, 0], ends[:, 2] - ends[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)


def _piercing(
    points: NDArray[np.float64],
    edges: NDArray[np.int64],
    corners: NDArray[np.integer],
    normals: NDArray[np.float64],
    numbers: NDArray[np.int64],
    least: float,
) -> Piercings:
    """Return the crossings among pairs of an edge and a triangle, by its number, that are deeper than `least` [m]."""
    starts, own = points[corners[numbers, 0]], normals[numbers]
    begins, ends = (np.einsum("ij,ij->i", points[edges[:, end]] - starts, own) for end in (0, 1))
    depths = np.minimum(np.abs(begins), np.abs(ends))
    across = np.flatnonzero((begins * ends < 0.0) & (depths > least))
    across = across[(edges[across, :, None] != corners[numbers[across], None, :]).all(axis=(1, 2))]
    edges, numbers, depths, own = edges[across], numbers[across], depths[across], own[across]
    parts = (begins[across] / (begins[across] - ends[across]))[:, None]
    places = points[edges[:, 0]] + parts * (points[edges[:, 1]] - points[edges[:, 0]])
    inside = np.ones(len(across), dtype=bool)
    for corner in range(3):
        here, there = (points[corners[numbers, end % 3]] for end in (corner, corner + 1))
        inside &= np.einsum("ij,ij->i", np.cross(there - here, places - here), own) > 0.0
    return Piercings(edges[inside], numbers[inside], depths[inside], places[inside])

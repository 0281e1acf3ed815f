"""Least distances at the start between parts that may touch later: particles and triangles, and edges and edges.

They may touch if all their corners are a distance apart. Between short ones that bounds how near their points are; it
says nothing between long ones, which are measured.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.triangles import triangles_of

Points = NDArray[np.float64]
ROWS = 2000
"""Number of triangles or edges that are compared together, to bound the memory"""


def least_gaps(mesh: PolygonMesh, apart: float, most: float) -> Points:
    """Return for each vertex the least distance between its triangles, edges or itself and parts that they may touch.

    Args:
        apart: distance between corners from which on they may touch [m].
        most: distance that counts as far [m], less than `apart` unless that is next to nothing.

    Returns:
        shape (vertex_count,) [m]; up to `most`. Smaller ones may belong to something beside the vertex.
    """
    points, triangles = mesh.points, triangles_of(mesh)
    gaps = np.full(len(points), most)
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    edges = np.unique(sides[sides[:, 0] != sides[:, 1]], axis=0)
    used = np.unique(triangles)[:, None]
    for things, others in ((triangles, used), (edges, edges)):
        for mine, theirs in _pairs(points, things, others, apart, most):
            between = np.linalg.norm(points[mine][:, :, None] - points[theirs][:, None], axis=-1)
            may = (between >= apart).all(axis=(1, 2)) & (mine[:, :, None] != theirs[:, None]).all(axis=(1, 2))
            mine, theirs = mine[may], theirs[may]
            measure = _to_triangles if things is triangles else _between_edges
            found = measure(points[mine], points[theirs])
            for ends in (*mine.T, *theirs.T):
                np.minimum.at(gaps, ends, found)
    return gaps


def _pairs(
    points: Points, things: NDArray[np.int64], others: NDArray[np.int64], apart: float, most: float
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Yield the corners of long things and of others whose centers are so near that they may be within a distance."""
    from scipy.spatial import KDTree  # takes long to load

    def reach(which: NDArray[np.int64]) -> Points:
        return np.linalg.norm(points[which] - points[which].mean(axis=1, keepdims=True), axis=-1).max(axis=1)

    lengths = np.linalg.norm(points[things] - points[np.roll(things, -1, axis=1)], axis=-1).max(axis=1, initial=0.0)
    long = things[lengths**2 > 2.0 * max(apart**2 - most**2, 0.0)]
    tree, farthest = KDTree(points[others].mean(axis=1)), float(reach(others).max(initial=0.0))
    for begin in range(0, len(long), ROWS):
        own = long[begin : begin + ROWS]
        near = tree.query_ball_point(points[own].mean(axis=1), reach(own) + farthest + most)
        counts = [len(each) for each in near]
        yield np.repeat(own, counts, axis=0), others[np.concatenate([np.zeros(0, dtype=np.int64), *near]).astype(int)]


def _between_edges(first: Points, second: Points) -> Points:
    """Return the distances of pairs of edges, each of shape (n, 2, 3) (Ericson 2005, Real-Time Collision Detection)."""
    way, other, begin = first[:, 1] - first[:, 0], second[:, 1] - second[:, 0], first[:, 0] - second[:, 0]
    a, e, b = _dot(way, way), _dot(other, other), _dot(way, other)
    c, f = _dot(way, begin), _dot(other, begin)
    across = a * e - b * b
    s = np.clip(np.divide(b * f - c * e, across, out=np.zeros_like(a), where=across > 1e-12 * a * e), 0.0, 1.0)
    t = np.clip((b * s + f) / e, 0.0, 1.0)
    s = np.clip((b * t - c) / a, 0.0, 1.0)
    return np.linalg.norm(begin + s[:, None] * way - t[:, None] * other, axis=1)


def _to_triangles(corners: Points, point: Points) -> Points:
    """Return the distances of points, shape (n, 1, 3), from triangles, shape (n, 3, 3)."""
    point = point[:, 0]
    alone = np.repeat(point[:, None], 2, axis=1)
    alone[:, 1] += 1e-12  # an edge that is a point
    found = np.min([_between_edges(corners[:, [k, (k + 1) % 3]], alone) for k in range(3)], axis=0)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    inside = length > 0.0
    for k in range(3):
        edge = corners[:, (k + 1) % 3] - corners[:, k]
        inside &= _dot(np.cross(edge, point - corners[:, k]), normal) >= 0.0
    height = np.abs(_dot(point - corners[:, 0], normal)) / np.where(length > 0.0, length, 1.0)
    return np.where(inside, height, found)


def _dot(first: Points, second: Points) -> Points:
    return np.einsum("ij,ij->i", first, second)

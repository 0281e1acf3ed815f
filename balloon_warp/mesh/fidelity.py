"""Whether a mesh stands for another one: closed, with nothing lost and no part of it in pieces."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from balloon_warp.mesh.components import component_labels
from balloon_warp.mesh.geometry import face_centers, first_coincident, triangulate
from balloon_warp.mesh.mesh_distance import MeshDistance
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.repair import distinct_faces
from balloon_warp.mesh.topology import border_edges, inconsistent_edges, mesh_edges, vertex_components

NEAR = 2.0
"""cells from a vertex of the result is where the surface should be: half an edge, half a slab and what is rounded"""
SPECK = 1.5
"""cells: a smaller part may be left out"""


def infidelity(surface: PolygonMesh, result: PolygonMesh, cell: float) -> str | None:
    """What is wrong with a closed mesh that was made of a surface, as the end of a sentence; None where nothing is.

    Args:
        surface: what it was made of; parts that overlap or come close may have become one.
        result: all whose vertices belong to faces.
        cell: width of a grid cell.
    """
    edges = mesh_edges(distinct_faces(result)[0])
    flaws = len(border_edges(edges)) + len(inconsistent_edges(edges))
    if flaws:
        return f"{flaws:,} of its edges {'is' if flaws == 1 else 'are'} open or crossed"
    points, parts = _samples(surface)
    labels = vertex_components(result, edges)
    made = len(np.unique(labels))
    lowest = np.full((int(parts.max()) + 1, 3), np.inf)
    highest = -lowest
    np.minimum.at(lowest, parts, points)
    np.maximum.at(highest, parts, points)
    sizes = np.linalg.norm(highest - lowest, axis=1)
    counts = sizes[parts] > SPECK * cell
    points, parts = points[counts], parts[counts]
    away, which = map(np.asarray, KDTree(result.points).query(points))
    far = away > NEAR * cell
    if place := _lost(points[far], result, cell):
        return f"the surface near {place} is lost"
    if place := _piece(points[~far], parts[~far], result, labels[which[~far]], labels, NEAR * cell):
        return f"one part comes to pieces near {place}"
    return f"{made:,} parts come of {len(sizes):,}" if made > len(sizes) else None


def _samples(surface: PolygonMesh) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The vertices of faces, and their middles: places, shape (n, 3), and the number of the part of each, shape (n,).
    Vertices at one place are one."""
    corners = first_coincident(surface.points)[surface.face_vertex_indices].astype(np.int64)
    of_faces = np.repeat(np.arange(surface.face_count), surface.face_vertex_counts)
    firsts = corners[np.cumsum(surface.face_vertex_counts) - surface.face_vertex_counts]
    labels = component_labels(surface.vertex_count, corners, firsts[of_faces])
    used = np.unique(corners)
    _, parts = np.unique(np.concatenate([labels[used], labels[firsts]]), return_inverse=True)
    return np.concatenate([surface.points[used], face_centers(surface)]), parts


def _lost(points: NDArray[np.float64], result: PolygonMesh, cell: float) -> str | None:
    """The first of some places that is out of the result; what is within it, as where parts overlap, is not lost."""
    if not len(points):
        return None
    middle = result.points.mean(axis=0)
    distance = MeshDistance((result.points - middle) / cell, triangulate(result)[0], thickness=0.0)
    out = points[distance((points - middle) / cell) > 0.0]
    return _place(out[0]) if len(out) else None


def _piece(
    points: NDArray[np.float64],
    parts: NDArray[np.int64],
    result: PolygonMesh,
    nearest: NDArray[np.int64],
    labels: NDArray[np.int64],
    near: float,
) -> str | None:
    """Where a part is missing from the component of the result that has most of it, if none is near all of it.

    Args:
        points: places, shape (n, 3).
        parts: the part of each, shape (n,).
        nearest: the component that is nearest to each, shape (n,).
        labels: the component of each vertex of the result.
        near: how far is near.
    """
    trees = {component: KDTree(result.points[labels == component]) for component in np.unique(nearest)}
    order = np.argsort(parts, kind="stable")
    for part in np.split(order, np.flatnonzero(np.diff(parts[order])) + 1):
        own, components = points[part], np.unique(nearest[part])
        missed = [own[np.asarray(trees[component].query(own)[0]) > near] for component in components]
        if missed and all(map(len, missed)):
            return _place(min(missed, key=len)[0])
    return None


def _place(point: NDArray[np.float64]) -> str:
    return f"({', '.join(f'{coordinate:.3g}' for coordinate in point)})"

"""Test that a mesh stands for another one: closed, with nothing lost and no part of it in pieces."""

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
"""Largest distance of a vertex of the result from the surface [cells]: half an edge, half a slab and rounding"""
SPECK = 1.5
"""Size below which a part may be left out [cells]"""


def infidelity(surface: PolygonMesh, result: PolygonMesh, cell: float) -> str | None:
    """Return the infidelity of a closed mesh to its source surface, as the end of a sentence; None if there is none.

    Args:
        surface: Source surface; parts that overlap or come close may have become one.
        result: Mesh whose vertices all belong to faces.
        cell: Width of a grid cell.
    """
    edges = mesh_edges(distinct_faces(result)[0])
    flaws = len(border_edges(edges)) + len(inconsistent_edges(edges))
    if flaws:
        return f"{flaws:,} of its edges {'is' if flaws == 1 else 'are'} open or crossed"
    points, parts = samples_of_parts(surface)
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
        return f"one part breaks into pieces near {place}"
    return f"it has {made:,} parts instead of {len(sizes):,}" if made > len(sizes) else None


def samples_of_parts(surface: PolygonMesh) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the vertices of faces and the faces' centers, shape (n, 3), with the part of each, shape (n,).

    Vertices at one place are one. Parts share no edge: an eye that touches its socket in a vertex is one.
    """
    corners = first_coincident(surface.points)[surface.face_vertex_indices].astype(np.int64)
    ends = np.cumsum(surface.face_vertex_counts)
    of_faces = np.repeat(np.arange(surface.face_count), surface.face_vertex_counts)
    following = np.arange(1, len(corners) + 1)
    following[ends - 1] = ends - surface.face_vertex_counts
    low, high = np.minimum(corners, corners[following]), np.maximum(corners, corners[following])
    _, edges = np.unique(low * len(surface.points) + high, return_inverse=True)
    count = surface.face_count
    labels = component_labels(count + int(edges.max()) + 1, of_faces, count + edges)[:count]
    _, parts = np.unique(labels, return_inverse=True)
    used = np.unique(np.stack([corners, parts[of_faces]], axis=1), axis=0)
    return np.concatenate([surface.points[used[:, 0]], face_centers(surface)]), np.concatenate([used[:, 1], parts])


def _lost(points: NDArray[np.float64], result: PolygonMesh, cell: float) -> str | None:
    """Return the first of some places outside of the result; places within it, as where parts overlap, are fine."""
    if not len(points):
        return None
    middle = result.points.mean(axis=0)
    distance = MeshDistance((result.points - middle) / cell, triangulate(result)[0], thickness=0.0)
    out = points[distance((points - middle) / cell) > 0.0]
    return place_said(out[0]) if len(out) else None


def _piece(
    points: NDArray[np.float64],
    parts: NDArray[np.int64],
    result: PolygonMesh,
    nearest: NDArray[np.int64],
    labels: NDArray[np.int64],
    near: float,
) -> str | None:
    """Return where a part is missing from its component of the result, unless a component is near all of it.

    Args:
        points: Places, shape (n, 3).
        parts: Part of each, shape (n,).
        nearest: Component that is nearest to each, shape (n,).
        labels: Component of each vertex of the result.
        near: Distance that counts as near.
    """
    trees = {component: KDTree(result.points[labels == component]) for component in np.unique(nearest)}
    order = np.argsort(parts, kind="stable")
    for part in np.split(order, np.flatnonzero(np.diff(parts[order])) + 1):
        own, components = points[part], np.unique(nearest[part])
        missed = [own[np.asarray(trees[component].query(own)[0]) > near] for component in components]
        if missed and all(map(len, missed)):
            return place_said(min(missed, key=len)[0])
    return None


def place_said(point: NDArray[np.float64]) -> str:
    """Return a place as text."""
    return f"({', '.join(f'{coordinate:.3g}' for coordinate in point)})"

"""Balloons that are folded at the start, where neighbors in space are not neighbors along the surface."""

import numpy as np

from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.thickness import length_graph
from balloon_warp.model.touch import APART, edge_length
from balloon_warp.scene import Balloon

DETOUR = 1.2
"""Least length of the way along the surface, over the distance below which particles are near each other in space, of
such that show that a surface is folded: along edges and diagonals, a flat one has ways up to 1.16"""
LAYERS = 2.5
"""Number of layers above which a surface is stacked, by how many particles they have"""
NARROW = 0.5
"""Distance between layers that lie on each other, over the mean edge: triangles have no such detours between them"""
HOPS = 2
"""Number of edges or diagonals that lead to all that is near in an even mesh"""
ROWS = 256
"""Number of particles whose ways are measured together, to bound the memory, and at most to find layers"""


def bends_freely(balloon: Balloon) -> bool:
    """Return whether nothing of a balloon's skin resists bending."""
    material, stiffness = balloon.material, balloon.stiffness
    stiff = "flexion" in material.springs if material.is_membrane else stiffness.flexion > 0.0
    return not stiff and not stiffness.torsion > 0.0


def is_stacked(mesh: PolygonMesh) -> bool:
    """Return whether more than two layers of a surface lie on each other, as they do not in flat foil.

    Looks where most is near: how much of that is near along the surface, too, is one layer.
    """
    from scipy.sparse.csgraph import dijkstra  # takes long to load
    from scipy.spatial import KDTree

    apart = APART * edge_length(mesh)
    used = np.unique(mesh.face_vertex_indices)
    points = mesh.points[used]
    tree = KDTree(points)
    fullest = np.argsort(-tree.query_ball_point(points, apart, return_length=True), kind="stable")[:ROWS]
    ways = dijkstra(length_graph(mesh), indices=used[fullest], limit=DETOUR * apart)[:, used]
    around = tree.query_ball_point(points[fullest], apart)
    return any(len(near) > LAYERS * np.isfinite(way[near]).sum() for near, way in zip(around, ways, strict=True))


def is_in_layers(mesh: PolygonMesh) -> bool:
    """Return whether layers of a surface lie on each other: nearer than half an edge, and far along it."""
    return is_folded(mesh, NARROW * edge_length(mesh))


def is_folded(mesh: PolygonMesh, nearer: float | None = None) -> bool:
    """Return whether parts of a surface are near each other, and far along it.

    Args:
        nearer: distance that counts as near [m]; that within which particles count as neighbors, if not given.
    """
    from scipy.sparse.csgraph import dijkstra  # takes long to load
    from scipy.spatial import KDTree

    apart = APART * edge_length(mesh)
    graph = length_graph(mesh)
    hops = graph.astype(bool)
    for _ in range(HOPS - 1):
        hops = hops + hops @ graph.astype(bool)
    used = np.zeros(mesh.vertex_count, dtype=bool)
    used[mesh.face_vertex_indices] = True
    pairs = KDTree(mesh.points).query_pairs(nearer or apart, output_type="ndarray").astype(np.int64)
    pairs = pairs[used[pairs].all(axis=1)]
    if not len(pairs):
        return False
    pairs = pairs[~np.asarray(hops[pairs[:, 0], pairs[:, 1]]).ravel().astype(bool)]
    starts, rows = np.unique(pairs[:, 0], return_inverse=True)
    for begin in range(0, len(starts), ROWS):
        own = (rows >= begin) & (rows < begin + ROWS)
        ways = dijkstra(graph, indices=starts[begin : begin + ROWS], limit=DETOUR * apart)
        if np.isinf(ways[rows[own] - begin, pairs[own, 1]]).any():
            return True
    return False

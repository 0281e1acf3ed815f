"""Slenderness of a surface: whether it has a part so long and thin that it may bend into itself, as a tube does."""

import numpy as np

from balloon_warp.mesh.corners import corner_faces
from balloon_warp.mesh.geometry import face_areas
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.thickness import length_graph
from balloon_warp.mesh.topology import is_closed, mesh_edges, vertex_components

BANDS = 24
"""Number of bands into which the surface is cut along its length"""
LEAST = 2.0
"""Least width of a band, in edges"""
FEW_BANDS = 4
"""Number of bands below which a surface has too few vertices along its length to bend"""
MOST_PARTS = 16
"""Largest number of components that are measured, of the largest areas"""


def slenderness(mesh: PolygonMesh) -> float:
    """Return the largest length of a part of a surface over its mean diameter, the length of a tube over its diameter.

    Distances along the surface from one of its ends cut it into bands. A part is some bands in a row, of area A over a
    length L; as a tube it has the diameter A / (pi L). A sphere has pi^2 / 4, a square sheet of two sides pi. An open
    mesh counts as if it had a second side. It is 0 where there are too few vertices along the length to bend.
    """
    from scipy.sparse.csgraph import dijkstra  # takes long to load

    edges = mesh_edges(mesh)
    shares = (1.0 if is_closed(edges) else 2.0) * face_areas(mesh) / mesh.face_vertex_counts
    areas = np.bincount(mesh.face_vertex_indices, shares[corner_faces(mesh)], mesh.vertex_count)
    components = vertex_components(mesh, edges)
    graph, most = length_graph(mesh), 0.0
    edge = float(graph.data.mean()) if graph.nnz else 1.0
    for component in np.argsort(-np.bincount(components, areas), kind="stable")[:MOST_PARTS]:
        members = np.flatnonzero((components == component) & (areas > 0.0))
        if not len(members):
            continue
        end = int(members[0])
        for _ in range(2):  # the farthest from anywhere is an end
            along = dijkstra(graph, directed=False, indices=end)[members]
            end = int(members[along.argmax()])
        along = dijkstra(graph, directed=False, indices=end)[members]
        count = int(np.clip(along.max() / (LEAST * edge), 1, BANDS))
        if count < FEW_BANDS:
            continue
        bands = np.minimum((along * (count / along.max())).astype(int), count - 1)
        sums = np.cumsum([0.0, *np.bincount(bands, areas[members], count)])
        begin, finish = np.triu_indices(count + 1, 1)
        lengths = (finish - begin) * along.max() / count
        held = sums[finish] - sums[begin]
        most = max(most, float((np.pi * lengths[held > 0.0] ** 2 / held[held > 0.0]).max()))
    return most

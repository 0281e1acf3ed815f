"""Requirements on a mesh of quads around a solid."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import (
    component_count,
    face_vector_areas,
    genus,
    inconsistent_edges,
    is_manifold,
    mesh_edges,
    signed_volume,
    vertex_normals,
)


def edge_lengths(mesh: PolygonMesh) -> NDArray[np.float64]:
    ends = mesh.points[mesh_edges(mesh).ends]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


def assert_closed_quads(mesh: PolygonMesh, holes_through: int = 0, parts: int = 1) -> None:
    edges = mesh_edges(mesh)
    assert (mesh.face_vertex_counts == 4).all()
    assert (edges.face_counts == 2).all()
    assert is_manifold(mesh, edges)
    assert len(inconsistent_edges(edges)) == 0
    assert component_count(mesh, edges) == parts
    assert genus(mesh, edges) == holes_through
    assert signed_volume(mesh) > 0.0


def assert_none_folded(mesh: PolygonMesh) -> None:
    """Require that each face points along the normals at its corners."""
    areas = face_vector_areas(mesh)
    normals = vertex_normals(mesh)[mesh.face_vertex_indices.reshape(-1, 4)]
    assert (np.einsum("fcj,fj->fc", normals, areas) > 0.0).all()


def sphere_distance(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.linalg.norm(points, axis=1) - 1.0

"""Test for a surface that comes near itself: parts that face each other across a gap which inflation may close."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.corners import corner_faces, face_starts
from balloon_warp.mesh.geometry import face_vector_areas, total_area
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.samples import even_samples
from balloon_warp.mesh.thickness import length_graph, relative_thickness
from balloon_warp.mesh.topology import is_closed, mesh_edges

SAMPLES = 4000
"""Number of samples on the surface, spread evenly by area"""
GROWTH = 1.5
"""Outward growth of a part, over the skin's stretch and over the radius of a sphere"""
FACING = -0.5
"""Cosine between normals of surfaces that face each other: a groove that opens by less than 60 degrees has such"""
DETOUR = 3.0
"""Least length of the path along the surface over the gap across: in a groove it is shorter"""
MOST_COMPARED = 10_000_000
"""Largest number of pairs of a vertex and a face that are compared to find that a mesh is convex"""
ROUNDING = 1e-9
"""Distance above a face times its area that is none, over the mesh's area to the power of 3/2"""
MOST_WAYS = 200
"""Largest number of sample pairs whose paths along the surface are measured"""


def nears_itself(mesh: PolygonMesh, stretch: float) -> bool:
    """Return whether parts of a closed mesh face each other across a gap that inflation may close.

    At a stretch of 1 + s a part of relative thickness t is taken to grow by `GROWTH` s t R, where R is the radius of a
    sphere of the mesh's area. Two samples are near each other where the one lies straight above the other, no farther
    than both grow, faces it, and is much farther away along the surface.
    """
    from scipy.spatial import KDTree  # takes long to load

    if not is_closed(mesh_edges(mesh)) or not total_area(mesh) or _is_convex(mesh):
        return False
    points, normals, vertices = even_samples(mesh, SAMPLES)
    most = GROWTH * stretch * float(np.sqrt(total_area(mesh) / (4.0 * np.pi)))
    pairs = KDTree(points).query_pairs(2.0 * most, output_type="ndarray")
    pairs = pairs[np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]]) < FACING]
    first, second = pairs.T
    between = points[second] - points[first]
    above, below = (np.einsum("ij,ij->i", way, normals[at]) for way, at in ((between, first), (-between, second)))
    gaps = np.linalg.norm(between, axis=1)
    aside = np.sqrt(np.maximum(gaps**2 - np.minimum(above, below) ** 2, 0.0))
    spacing = np.sqrt(total_area(mesh) / len(points))
    facing = np.flatnonzero((above > 0.0) & (below > 0.0) & (aside < np.maximum(above, spacing)))
    if not len(facing):
        return False
    grows = most * relative_thickness(mesh)[vertices]
    near = facing[gaps[facing] < grows[first[facing]] + grows[second[facing]]]
    chosen = near[:: -(-len(near) // MOST_WAYS) or 1]
    return _are_far_along(mesh, vertices[first[chosen]], vertices[second[chosen]], gaps[chosen])


def _is_convex(mesh: PolygonMesh) -> bool:
    """Return whether no vertex is above a face, whose plane goes through its highest corner; False for large meshes.

    It is the quick answer for balls: no two parts of a convex surface face each other.
    """
    if mesh.face_count * mesh.vertex_count > MOST_COMPARED:
        return False
    normals = face_vector_areas(mesh)
    corners = np.einsum("ij,ij->i", normals[corner_faces(mesh)], mesh.points[mesh.face_vertex_indices])
    highest = np.maximum.reduceat(corners, face_starts(mesh))
    above = normals @ mesh.points[np.unique(mesh.face_vertex_indices)].T - highest[:, None]
    return bool(above.max() <= ROUNDING * total_area(mesh) ** 1.5)


def _are_far_along(
    mesh: PolygonMesh, first: NDArray[np.integer], second: NDArray[np.integer], gaps: NDArray[np.float64]
) -> bool:
    """Return whether any two vertices are much farther from each other along the surface than across the gap."""
    from scipy.sparse.csgraph import dijkstra

    if not len(gaps):
        return False
    sources, rows = np.unique(first, return_inverse=True)
    limit = DETOUR * float(gaps.max())
    along = dijkstra(length_graph(mesh), directed=False, indices=sources, limit=limit)
    edge = np.sqrt(total_area(mesh) / mesh.vertex_count)  # the vertices are up to that far from the samples
    return bool((along[rows, second] > DETOUR * gaps + edge).any())

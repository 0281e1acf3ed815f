"""Topology of a mesh: corners, edges, borders, manifoldness, winding, components, genus."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.polygon_mesh import PolygonMesh


def component_labels(count: int, first: NDArray[np.int64], second: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the lowest node that each node is connected with, shape (count,).

    Args:
        count: nodes, numbered from 0.
        first: one end of each edge, shape (edge_count,).
        second: the other end, shape (edge_count,).
    """
    labels = np.arange(count)
    while True:
        low = np.minimum(labels[first], labels[second])
        high = np.maximum(labels[first], labels[second])
        if (low == high).all():
            return labels
        # Hook each root below its lowest neighbor, then let every node point at its root.
        np.minimum.at(labels, high, low)
        while (labels != labels[labels]).any():
            labels = labels[labels]


def face_starts(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Return the first corner of each face, shape (face_count,)."""
    return np.cumsum(mesh.face_vertex_counts, dtype=np.int64) - mesh.face_vertex_counts


def corner_faces(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Return the face of each corner, shape (corner_count,)."""
    return np.repeat(np.arange(mesh.face_count), mesh.face_vertex_counts)


def next_corners(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Return the corner that follows each corner around its face, shape (corner_count,)."""
    following = np.arange(1, len(mesh.face_vertex_indices) + 1)
    starts = face_starts(mesh)
    following[starts + mesh.face_vertex_counts - 1] = starts
    return following


def corners_beside(mesh: PolygonMesh, gone: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return the corners of all faces; those of a face that is gone are all at its first vertex.

    Args:
        gone: shape (face_count,).
    """
    places = np.arange(len(mesh.face_vertex_indices))
    faces = corner_faces(mesh)
    return mesh.face_vertex_indices[np.where(gone[faces], face_starts(mesh)[faces], places)]


def beside_faces(mesh: PolygonMesh, gone: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return a mask of the vertices that still have a face, shape (vertex_count,); all where no face is left.

    Args:
        gone: shape (face_count,).
    """
    held = np.zeros(mesh.vertex_count, dtype=bool)
    held[mesh.face_vertex_indices[~gone[corner_faces(mesh)]]] = True
    return held if held.any() else ~held


def with_corners(mesh: PolygonMesh, corners: NDArray[np.integer | np.bool_]) -> PolygonMesh:
    """Return the mesh with some of its corners, in order or by a mask, and all that belongs to them."""
    textures = mesh.texture_coordinates
    return replace(
        mesh,
        face_vertex_indices=mesh.face_vertex_indices[corners],
        texture_coordinates=None if textures is None else textures[corners],
        looks=mesh.looks and mesh.looks.at(corners),
    )


def backward_corners(mesh: PolygonMesh) -> NDArray[np.integer]:
    """Return the corners of all faces with each face run backwards, as numbers for `with_corners`."""
    return flip_faces(mesh.face_vertex_counts, np.arange(len(mesh.face_vertex_indices)))


def flipped(mesh: PolygonMesh, flip: NDArray[np.bool_]) -> PolygonMesh:
    """Return the mesh with some faces, by a mask of shape (face_count,), run backwards."""
    at_corners = flip[corner_faces(mesh)]
    return with_corners(mesh, np.where(at_corners, backward_corners(mesh), np.arange(len(at_corners))))


def flip_faces(counts: NDArray[np.integer], indices: NDArray[np.integer]) -> NDArray[np.integer]:
    """Return the corners of all faces with each face run backwards from the same first corner.

    Args:
        counts: corners of each face, shape (face_count,), all at least 1.
        indices: corners of all faces, shape (corner_count,).
    """
    starts = np.cumsum(counts, dtype=np.int64) - counts
    place = np.arange(len(indices)) - np.repeat(starts, counts)
    sizes = np.repeat(counts, counts)
    return indices[np.repeat(starts, counts) + (sizes - place) % sizes]


def edges_of(mesh: PolygonMesh) -> NDArray[np.int32]:
    """Return each pair of vertices that is a side of a face, once, lower first, shape (edge_count, 2)."""
    corners = mesh.face_vertex_indices
    sides = np.stack([corners, corners[next_corners(mesh)]], axis=1)
    return np.unique(np.sort(sides, axis=1), axis=0).astype(np.int32)


@dataclass(frozen=True)
class MeshEdges:
    """The edges of a mesh, sorted by their ends. A half-edge is an edge as one face runs along it."""

    ends: NDArray[np.int64]
    """Ends of edges, the lower vertex first, shape (edge_count, 2)"""
    face_counts: NDArray[np.int64]
    """Number of half-edges on each edge, which is its number of faces, shape (edge_count,)"""
    corners: NDArray[np.int64]
    """Corner where each half-edge begins, grouped by edge, shape (half_edge_count,)"""
    forward: NDArray[np.bool_]
    """Whether each half-edge runs from the lower to the higher vertex, shape (half_edge_count,)"""

    @property
    def count(self) -> int:
        return len(self.ends)

    @property
    def starts(self) -> NDArray[np.int64]:
        """Begin of each edge's half-edges in `corners`, shape (edge_count,)."""
        return np.cumsum(self.face_counts) - self.face_counts


def mesh_edges(mesh: PolygonMesh) -> MeshEdges:
    """Return the undirected edges and the half-edges on each. A corner repeated in a row makes no edge."""
    begin = mesh.face_vertex_indices.astype(np.int64)
    end = begin[next_corners(mesh)]
    corners = np.flatnonzero(begin != end)
    begin, end = begin[corners], end[corners]
    keys = np.minimum(begin, end) * mesh.vertex_count + np.maximum(begin, end)
    order = np.argsort(keys, kind="stable")
    unique, face_counts = np.unique(keys, return_counts=True)
    return MeshEdges(
        ends=np.stack(np.divmod(unique, max(mesh.vertex_count, 1)), axis=1),
        face_counts=face_counts,
        corners=corners[order],
        forward=(begin < end)[order],
    )


def unused_vertices(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Return the vertices of no face, in order."""
    return np.flatnonzero(np.bincount(mesh.face_vertex_indices, minlength=mesh.vertex_count) == 0)


def repeated_corners(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Return the corners, in order, at vertices where their face has been before."""
    order = np.lexsort((mesh.face_vertex_indices, corner_faces(mesh)))  # stable: first visits come first
    faces, vertices = corner_faces(mesh), mesh.face_vertex_indices[order]
    return np.sort(order[1:][(vertices[1:] == vertices[:-1]) & (faces[1:] == faces[:-1])])


def first_alike(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Return, for each face, the first with the same corners, in any order, shape (face_count,)."""
    vertices = mesh.face_vertex_indices[np.lexsort((mesh.face_vertex_indices, corner_faces(mesh)))]
    starts, first = face_starts(mesh), np.arange(mesh.face_count)
    for size in np.unique(mesh.face_vertex_counts):
        faces = np.flatnonzero(mesh.face_vertex_counts == size)
        table = vertices[starts[faces, None] + np.arange(size)]
        order = np.lexsort(table.T)  # stable: the first comes first
        begins = np.append(True, (table[order[1:]] != table[order[:-1]]).any(axis=1))
        first[faces[order]] = faces[order[begins][np.cumsum(begins) - 1]]
    return first


def duplicate_faces(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Return the faces, in order, with the same corners as an earlier one, in any order."""
    return np.flatnonzero(first_alike(mesh) != np.arange(mesh.face_count))


def border_edges(edges: MeshEdges) -> NDArray[np.int64]:
    """Return the edges of one face only, as numbers into `edges`."""
    return np.flatnonzero(edges.face_counts == 1)


def non_manifold_edges(edges: MeshEdges) -> NDArray[np.int64]:
    """Return the edges of three faces or more, as numbers into `edges`."""
    return np.flatnonzero(edges.face_counts > 2)


def inconsistent_edges(edges: MeshEdges) -> NDArray[np.int64]:
    """Return edges along which two faces or more run the same way, so that their normals are inconsistent."""
    forward = np.add.reduceat(edges.forward, edges.starts, dtype=np.int64) if edges.count else edges.face_counts
    return np.flatnonzero(np.maximum(forward, edges.face_counts - forward) > 1)


def non_manifold_vertices(mesh: PolygonMesh, edges: MeshEdges) -> NDArray[np.int64]:
    """Return vertices whose faces do not form one fan, such as where two cones touch at their tips."""
    following = next_corners(mesh)
    begin = edges.corners
    # Corners at one vertex belong to one fan where their faces share an edge there. Each half-edge is compared with
    # the first on its edge.
    reference = np.repeat(edges.starts, edges.face_counts)
    low = np.where(edges.forward, begin, following[begin])
    high = np.where(edges.forward, following[begin], begin)
    repeated = np.flatnonzero(mesh.face_vertex_indices == mesh.face_vertex_indices[following])
    fans = component_labels(
        len(mesh.face_vertex_indices),
        np.concatenate([low, high, repeated]),
        np.concatenate([low[reference], high[reference], following[repeated]]),
    )
    fan_vertices = mesh.face_vertex_indices[np.unique(fans)]
    return np.flatnonzero(np.bincount(fan_vertices, minlength=mesh.vertex_count) > 1)


def vertex_components(mesh: PolygonMesh, edges: MeshEdges) -> NDArray[np.int64]:
    """Return the lowest vertex that each vertex is connected with along edges, shape (vertex_count,)."""
    return component_labels(mesh.vertex_count, edges.ends[:, 0], edges.ends[:, 1])


def component_count(mesh: PolygonMesh, edges: MeshEdges) -> int:
    """Return the connected components among the vertices of faces."""
    return len(np.unique(vertex_components(mesh, edges)[mesh.face_vertex_indices]))


def euler_characteristic(mesh: PolygonMesh, edges: MeshEdges) -> int:
    """Return the vertices - edges + faces, unused vertices not counted."""
    return mesh.vertex_count - len(unused_vertices(mesh)) - edges.count + mesh.face_count


def is_closed(edges: MeshEdges) -> bool:
    """Return whether there are edges, and no border among them."""
    return edges.count > 0 and len(border_edges(edges)) == 0


def is_manifold(mesh: PolygonMesh, edges: MeshEdges) -> bool:
    """Return whether each edge has at most two faces, and the faces at each vertex form one fan."""
    return len(non_manifold_edges(edges)) == 0 and len(non_manifold_vertices(mesh, edges)) == 0


def is_orientable(mesh: PolygonMesh, edges: MeshEdges) -> bool:
    """Return whether flipping faces could make the winding consistent; for edges of at most two faces."""
    # Each face stands for two nodes, as it is and turned over. A surface with one side connects the two.
    pairs = edges.starts[edges.face_counts == 2]
    face = corner_faces(mesh)[edges.corners]
    first, second = face[pairs], face[pairs + 1]
    turned = (edges.forward[pairs] == edges.forward[pairs + 1]) * mesh.face_count
    sides = component_labels(
        2 * mesh.face_count,
        np.concatenate([first, first + mesh.face_count]),
        np.concatenate([second + turned, second + mesh.face_count - turned]),
    )
    return bool((sides[: mesh.face_count] != sides[mesh.face_count :]).all())


def genus(mesh: PolygonMesh, edges: MeshEdges) -> int | None:
    """Return the handles, summed over the components; None unless the mesh is closed, manifold and orientable."""
    if not (is_closed(edges) and is_manifold(mesh, edges) and is_orientable(mesh, edges)):
        return None
    return component_count(mesh, edges) - euler_characteristic(mesh, edges) // 2

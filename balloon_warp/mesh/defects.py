"""What is odd about a mesh, for people: a sentence for each kind of defect. Faces and vertices are counted from 1."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.corners import corner_faces, face_starts, next_corners
from balloon_warp.mesh.geometry import face_areas, face_volumes, first_coincident
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import (
    MeshEdges,
    border_edges,
    inconsistent_edges,
    non_manifold_edges,
    non_manifold_vertices,
    unused_vertices,
    vertex_components,
)

# A face is of no area below this part of its longest edge squared: far thinner than float32 can hold open.
NO_AREA = 1e-9


def describe_defects(mesh: PolygonMesh, edges: MeshEdges) -> list[str]:
    """A sentence for each kind of defect that the mesh has, with how many there are and the first."""
    sentences = [
        _about_faces(_faces_with_repeated_corners(mesh), "repeats a corner", "repeat a corner"),
        _about_faces(_faces_without_area(mesh), "has no area", "have no area"),
        _about_faces(_duplicate_faces(mesh), "has the corners of an earlier face", "have the corners of earlier faces"),
        _about_coincident_vertices(mesh),
        _about_vertices(unused_vertices(mesh), "belongs to no face", "belong to no face"),
        _about_vertices(
            non_manifold_vertices(mesh, edges),
            "joins parts of the surface that share no edge there",
            "join parts of the surface that share no edge there",
        ),
        _about_edges(border_edges(edges), edges, "is on an open border", "are on open borders"),
        _about_edges(non_manifold_edges(edges), edges, "has more than two faces", "have more than two faces"),
        _about_edges(
            inconsistent_edges(edges), edges, "joins faces of opposite winding", "join faces of opposite winding"
        ),
        _about_inward_components(mesh, edges),
    ]
    return [sentence for sentence in sentences if sentence]


def _faces_with_repeated_corners(mesh: PolygonMesh) -> NDArray[np.int64]:
    faces, vertices = corner_faces(mesh), _sorted_corners(mesh)
    return np.unique(faces[1:][(vertices[1:] == vertices[:-1]) & (faces[1:] == faces[:-1])])


def _faces_without_area(mesh: PolygonMesh) -> NDArray[np.int64]:
    corners = mesh.points[mesh.face_vertex_indices]
    lengths = np.linalg.norm(corners[next_corners(mesh)] - corners, axis=1)
    longest = np.maximum.reduceat(lengths, face_starts(mesh))
    return np.flatnonzero(face_areas(mesh) <= NO_AREA * longest**2)


def _duplicate_faces(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Faces with the same corners as an earlier one, in whatever order."""
    vertices, starts = _sorted_corners(mesh), face_starts(mesh)
    duplicate = np.zeros(mesh.face_count, dtype=bool)
    for size in np.unique(mesh.face_vertex_counts):
        faces = np.flatnonzero(mesh.face_vertex_counts == size)
        table = vertices[starts[faces, None] + np.arange(size)]
        order = np.lexsort(table.T)
        same = (table[order[1:]] == table[order[:-1]]).all(axis=1)
        duplicate[faces[order[1:][same]]] = True
    return np.flatnonzero(duplicate)


def _sorted_corners(mesh: PolygonMesh) -> NDArray[np.int32]:
    """Corners of all faces, those of each face in rising order."""
    return mesh.face_vertex_indices[np.lexsort((mesh.face_vertex_indices, corner_faces(mesh)))]


def _about_coincident_vertices(mesh: PolygonMesh) -> str | None:
    used = np.unique(mesh.face_vertex_indices)
    first = used[first_coincident(mesh.points[used])]
    later = np.flatnonzero(first != used)
    if len(later):
        vertex, place = used[later[0]] + 1, first[later[0]] + 1
        where = f"is vertex {vertex}, at the place of vertex {place}"
        return _sentence(len(later), "vertex", "lies exactly on another", "lie exactly on others", where)


def _about_inward_components(mesh: PolygonMesh, edges: MeshEdges) -> str | None:
    """About components that have an inside, being closed and consistently wound, and face it."""
    component = vertex_components(mesh, edges)
    face_component = component[mesh.face_vertex_indices[face_starts(mesh)]]
    has_inside = np.ones(mesh.vertex_count, dtype=bool)
    for spoiled in (border_edges(edges), inconsistent_edges(edges)):
        has_inside[component[edges.ends[spoiled, 0]]] = False
    volumes = np.bincount(face_component, face_volumes(mesh), mesh.vertex_count)
    inward = np.flatnonzero(has_inside & (volumes < 0.0))
    if len(inward):
        face = int(np.isin(face_component, inward).argmax()) + 1
        one, many = "winds inward, so that inflation shrinks it", "wind inward, so that inflation shrinks them"
        return _sentence(len(inward), "closed component", one, many, f"has face {face}")


def _about_faces(found: NDArray[np.int64], one: str, many: str) -> str | None:
    if len(found):
        return _sentence(len(found), "face", one, many, f"is face {found[0] + 1}")


def _about_vertices(found: NDArray[np.int64], one: str, many: str) -> str | None:
    if len(found):
        return _sentence(len(found), "vertex", one, many, f"is vertex {found[0] + 1}")


def _about_edges(found: NDArray[np.int64], edges: MeshEdges, one: str, many: str) -> str | None:
    if len(found):
        low, high = edges.ends[found[0]] + 1
        return _sentence(len(found), "edge", one, many, f"goes from vertex {low} to {high}")


def _sentence(count: int, noun: str, one: str, many: str, predicate: str) -> str:
    if count == 1:
        return f"1 {noun} {one}; it {predicate}, counting from 1."
    plural = "vertices" if noun == "vertex" else f"{noun}s"
    return f"{count:,} {plural} {many}; the first {predicate}, counting from 1."

"""Defects of a mesh and their treatment, for people: two sentences for each kind of defect.

Faces and vertices are counted from 1.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.check import LARGEST_FAN
from balloon_warp.mesh.corners import corner_faces, face_starts, next_corners
from balloon_warp.mesh.geometry import face_areas, first_coincident
from balloon_warp.mesh.orientation import inward_faces, wound_alike
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.repair import distinct_faces
from balloon_warp.mesh.topology import (
    MeshEdges,
    border_edges,
    inconsistent_edges,
    mesh_edges,
    non_manifold_edges,
    non_manifold_vertices,
    repeated_corners,
    unused_vertices,
    vertex_components,
)

# A face is of no area below this part of its longest edge squared: far thinner than float32 can hold open.
NO_AREA = 1e-9


def describe_defects(
    mesh: PolygonMesh, whole: PolygonMesh, parts: Literal["held", "free"], left_out: NDArray[np.integer]
) -> list[str]:
    """Describe each kind of defect in the mesh: the number, the first, and the treatment.

    Args:
        whole: Mesh once repaired, whose open edges stay so.
        parts: Whether components are held together.
        left_out: Vertices of parts that are left out.
    """
    distinct, kept = distinct_faces(mesh)
    edges, edges_left = mesh_edges(distinct), mesh_edges(whole)
    sentences = [
        _about_faces(
            np.unique(corner_faces(mesh)[repeated_corners(mesh)]),
            "repeats a corner",
            "repeat a corner",
            "Repeated corners count once.",
        ),
        _about_faces(
            _faces_without_area(mesh),
            "has no area",
            "have no area",
            "Such a face has springs, and is inflated once it opens, unless it is a fin.",
        ),
        _about_faces(
            _duplicates(mesh, kept),
            "has the corners of an earlier face",
            "have the corners of earlier faces",
            "Repeated faces count once.",
        ),
        _about_coincident_vertices(mesh),
        _about_vertices(
            np.setdiff1d(unused_vertices(mesh), np.concatenate([mesh.left_vertices, left_out])),
            "belongs to no face",
            "belong to no face",
            "Such a vertex keeps its number, has no mass and stays where it is.",
        ),
        _about_vertices(
            non_manifold_vertices(distinct, edges),
            "joins parts of the surface that share no edge there",
            "join parts of the surface that share no edge there",
            "The parts stay joined there.",
        ),
        _about_vertices(
            np.flatnonzero(np.bincount(edges.ends.ravel()) > LARGEST_FAN),
            f"has more than {LARGEST_FAN} neighbors",
            f"have more than {LARGEST_FAN} neighbors",
            "Beyond, each neighbor gets one flexion spring instead of one to every other neighbor.",
        ),
        _about_edges(
            border_edges(edges_left),
            edges_left,
            "is on an open border",
            "are on open borders",
            "An open part is inflated if its border is pinned, and carried along otherwise; it cannot hold gas.",
        ),
        _about_edges(
            non_manifold_edges(edges),
            edges,
            "has more than two faces",
            "have more than two faces",
            "A pressure acts on faces between inside and outside, not on walls or fins; such a mesh cannot hold gas.",
        ),
        _about_opposite_winding(distinct, edges),
        _about_inward_components(distinct, edges, kept),
        _about_components(distinct, edges, kept, parts),
    ]
    return [sentence for sentence in sentences if sentence]


def _duplicates(mesh: PolygonMesh, kept: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the faces of three different corners or more that are not kept."""
    corners = np.bincount(corner_faces(mesh), minlength=mesh.face_count)
    corners -= np.bincount(corner_faces(mesh)[repeated_corners(mesh)], minlength=mesh.face_count)
    return np.setdiff1d(np.flatnonzero(corners >= 3), kept)


def _faces_without_area(mesh: PolygonMesh) -> NDArray[np.int64]:
    corners = mesh.points[mesh.face_vertex_indices]
    lengths = np.linalg.norm(corners[next_corners(mesh)] - corners, axis=1)
    longest = np.maximum.reduceat(lengths, face_starts(mesh))
    return np.flatnonzero(face_areas(mesh) <= NO_AREA * longest**2)


def _about_coincident_vertices(mesh: PolygonMesh) -> str | None:
    used = np.unique(mesh.face_vertex_indices)
    first = used[first_coincident(mesh.points[used])]
    later = np.flatnonzero(first != used)
    if len(later):
        vertex, place = used[later[0]] + 1, first[later[0]] + 1
        where = f"is vertex {vertex}, at the place of vertex {place}"
        policy = "They are separate particles; --weld merges them."
        return _sentence(len(later), "vertex", "lies exactly on another", "lie exactly on others", where, policy)


def _about_opposite_winding(mesh: PolygonMesh, edges: MeshEdges) -> str | None:
    found = _turned_edges(edges)
    if not len(found):
        return None
    left = _turned_edges(mesh_edges(wound_alike(mesh)))
    policy = (
        "The surface is not orientable, like a Moebius strip: it has no inside, and is carried along."
        if len(left)
        else "Faces are flipped until all wind alike."
    )
    return _about_edges(found, edges, "joins faces of opposite winding", "join faces of opposite winding", policy)


def _turned_edges(edges: MeshEdges) -> NDArray[np.int64]:
    """Return the edges of two faces that run the same way along it."""
    found = inconsistent_edges(edges)
    return found[edges.face_counts[found] == 2]


def _about_inward_components(mesh: PolygonMesh, edges: MeshEdges, kept: NDArray[np.int64]) -> str | None:
    inward = np.flatnonzero(inward_faces(mesh, edges))
    if len(inward):
        count = len(np.unique(_face_components(mesh, edges)[inward]))
        policy = "Such a component is flipped outward."
        return _sentence(
            count, "closed component", "winds inward", "wind inward", f"has face {kept[inward[0]] + 1}", policy
        )


def _about_components(
    mesh: PolygonMesh, edges: MeshEdges, kept: NDArray[np.int64], parts: Literal["held", "free"]
) -> str | None:
    component = _face_components(mesh, edges)
    count = len(np.unique(component))
    if count > 1:
        apart = kept[int((component != component[0]).argmax())] + 1
        became = (
            'are tied together by springs; parts = "free" lets them separate'
            if parts == "held"
            else "are inflated as one balloon, and free to separate"
        )
        return f"{count:,} separate parts (the second starts at face {apart}) {became}."


def _face_components(mesh: PolygonMesh, edges: MeshEdges) -> NDArray[np.int64]:
    return vertex_components(mesh, edges)[mesh.face_vertex_indices[face_starts(mesh)]]


def _about_faces(found: NDArray[np.int64], one: str, many: str, policy: str) -> str | None:
    if len(found):
        return _sentence(len(found), "face", one, many, f"is face {found[0] + 1}", policy)


def _about_vertices(found: NDArray[np.integer], one: str, many: str, policy: str) -> str | None:
    if len(found):
        return _sentence(len(found), "vertex", one, many, f"is vertex {found[0] + 1}", policy)


def _about_edges(found: NDArray[np.int64], edges: MeshEdges, one: str, many: str, policy: str) -> str | None:
    if len(found):
        low, high = edges.ends[found[0]] + 1
        return _sentence(len(found), "edge", one, many, f"goes from vertex {low} to {high}", policy)


def _sentence(count: int, noun: str, one: str, many: str, predicate: str, policy: str) -> str:
    if count == 1:
        return f"1 {noun} {one}; it {predicate}, counting from 1. {policy}"
    plural = "vertices" if noun == "vertex" else f"{noun}s"
    return f"{count:,} {plural} {many}; the first {predicate}, counting from 1. {policy}"

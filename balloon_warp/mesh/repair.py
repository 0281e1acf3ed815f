"""Defects of a mesh: their names, their treatment, and the repaired mesh.

Parts of a surface whose sides are wrong: the outer one inside it, or the inner one outside.

The winding number of a closed surface that faces outward is 1 on its inside and 0 on its outside. Just above a triangle
it is 1 or more where another part of the surface encloses the triangle; just below, it is 0 or less where the surface
is turned inside out.

Defects of a mesh and their treatment, for people: two sentences for each kind of defect.

Faces and vertices are counted from 1.
"""

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.check import LARGEST_FAN
from balloon_warp.mesh.geometry import face_areas, first_coincident, triangulate
from balloon_warp.mesh.holes import with_lids
from balloon_warp.mesh.orientation import facing_outward, inward_faces, wound_alike
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import (
    MeshEdges,
    border_edges,
    corner_faces,
    duplicate_faces,
    face_starts,
    inconsistent_edges,
    mesh_edges,
    next_corners,
    non_manifold_edges,
    non_manifold_vertices,
    repeated_corners,
    unused_vertices,
    vertex_components,
    with_corners,
)

NEAR = 0.02
"""Distance above and below a triangle at which samples are tested, over the root of its area"""


class WrongSides(NamedTuple):
    """Triangles of a mesh, as in `triangulate`, whose sides are wrong."""

    areas: NDArray[np.float64]
    """Areas of the triangles, in the mesh's unit squared, shape (triangle_count,)"""
    enclosed: NDArray[np.bool_]
    """Mask of triangles whose outer side lies within the surface, shape (triangle_count,)"""
    reversed: NDArray[np.bool_]
    """Mask of triangles whose inner side lies outside the surface, shape (triangle_count,)"""


def wrong_sides(mesh: PolygonMesh) -> WrongSides:
    """Return the triangles of a closed mesh that lie within it, and those that are turned inside out."""
    from balloon_warp.mesh.surface_nets import MeshDistance  # takes long to load

    points = mesh.points - mesh.points.mean(axis=0)
    triangles, _ = triangulate(mesh)
    a, b, c = points[triangles].swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    sizes = np.sqrt(np.linalg.norm(normals, axis=1, keepdims=True))
    has_area = sizes[:, 0] > 0.0
    step = NEAR * np.divide(normals, sizes, out=np.zeros_like(normals), where=sizes > 0.0)
    distance, centers = MeshDistance(points, triangles, thickness=0.0), (a + b + c) / 3.0
    enclosed, reversed_ = distance(centers + step) < 0.0, distance(centers - step) > 0.0
    return WrongSides(0.5 * sizes[:, 0] ** 2, has_area & enclosed, has_area & reversed_)


def repaired(mesh: PolygonMesh, source: object, holes: Literal["cap", "keep"] = "cap") -> PolygonMesh:
    """Return the mesh without repeated corners and faces, wound outward, and with lids on its holes.

    Vertices stay.

    Raises:
        InputError: no face is left; it names `source`.
    """
    mesh, kept = distinct_faces(mesh)
    if not len(kept):
        raise InputError(f"{source}: has no face with three different corners")
    return facing_outward(mesh if holes == "keep" else with_lids(wound_alike(mesh)))


def distinct_faces(mesh: PolygonMesh) -> tuple[PolygonMesh, NDArray[np.int64]]:
    """Return the mesh without repeated vertices in faces and without repeated faces, and the kept faces in order.

    A vertex stays where a face comes to it first. Faces that then have under three vertices, or the corners of an
    earlier face, go.
    """
    mesh = _distinct_corners(mesh)
    keep = mesh.face_vertex_counts >= 3
    keep[duplicate_faces(mesh)] = False
    kept = with_corners(mesh, keep[corner_faces(mesh)])
    return replace(kept, face_vertex_counts=mesh.face_vertex_counts[keep]), np.flatnonzero(keep)


def _distinct_corners(mesh: PolygonMesh) -> PolygonMesh:
    first = np.ones(len(mesh.face_vertex_indices), dtype=bool)
    first[repeated_corners(mesh)] = False
    counts = np.bincount(corner_faces(mesh)[first], minlength=mesh.face_count).astype(np.int32)
    return replace(with_corners(mesh, first), face_vertex_counts=counts)


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

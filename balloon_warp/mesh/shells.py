"""Faces that separate a mesh's inside from the outside, and the side on which a pressure pushes them.

A face has two sides. Around an edge its faces stand like pages around a spine, and the space between one and the next
sees a side of each: these sides are of one *room*. So they are where a border is free: there one goes around it. The
outside is a room, too. A face with the outside on one of its sides alone is pushed that way. One with the same on both,
as a sheet, a fin, a Moebius strip or the wall between two rooms, is not: then for any faces, those that are
pushed go all around something, so that the pressure is the gradient of a volume. It has no net force, and does no work
on the way around.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import face_vector_areas, face_volumes
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import (
    MeshEdges,
    component_labels,
    corner_faces,
    face_starts,
    flipped,
    mesh_edges,
    with_corners,
)


def pushes(mesh: PolygonMesh, edges: MeshEdges, held: NDArray[np.bool_] | None = None) -> NDArray[np.int64]:
    """Return how a pressure pushes each face: 1 along its normal, -1 against it, 0 neither, shape (face_count,).

    Connected faces that go all around something as they wind are pushed as they wind.

    A component connected along edges, whose winding encloses a volume, is pushed as it winds.

    Args:
        mesh: wound alike where a winding fits.
        edges: of the mesh.
        held: the vertices that do not move, shape (vertex_count,): no way leads around a border between two of them.
    """
    faces = corner_faces(mesh)[edges.corners]
    balance = _sums(2 * edges.forward.astype(np.int64) - 1, edges)
    balance[_held_borders(edges, held)] = 0
    first = np.repeat(edges.starts, edges.face_counts)
    parts = component_labels(mesh.face_count, faces, faces[first])
    spoiled = np.zeros(mesh.face_count, dtype=bool)
    spoiled[parts[faces[edges.starts[balance != 0]]]] = True
    if not spoiled.any():
        return np.ones(mesh.face_count, dtype=np.int64)
    rooms = _rooms(mesh, edges, faces, held)
    outside = _outside(mesh, rooms, parts)
    found = outside[rooms[:, 0]].astype(np.int64) - outside[rooms[:, 1]]
    return np.where(spoiled[parts], found, 1)


def pushed_outward(mesh: PolygonMesh, held: NDArray[np.bool_] | None = None) -> tuple[PolygonMesh, NDArray[np.bool_]]:
    """Return the mesh with faces flipped that a pressure pushes against their normals, and which are not pushed.

    The mask has shape (face_count,).

    Args:
        mesh: wound alike where a winding fits.
        held: the vertices that do not move, shape (vertex_count,).
    """
    found = pushes(mesh, mesh_edges(mesh), held)
    return (flipped(mesh, found < 0) if (found < 0).any() else mesh), found == 0


def there_and_back(mesh: PolygonMesh, faces: NDArray[np.bool_]) -> PolygonMesh:
    """Return the mesh with some faces, by a mask, run along their corners and back again.

    There are as many faces around the same vertices, but these have no area, no volume and no border.
    """
    if not faces.any():
        return mesh
    sizes = mesh.face_vertex_counts.astype(np.int64)
    counts = np.where(faces, 2 * sizes - 2, sizes)
    place = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    size, start = np.repeat(sizes, counts), np.repeat(face_starts(mesh), counts)
    turned = with_corners(mesh, start + np.where(place < size, place, 2 * (size - 1) - place))
    return replace(turned, face_vertex_counts=counts.astype(np.int32))


def _held_borders(edges: MeshEdges, held: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
    border = edges.face_counts == 1
    return border & held[edges.ends].all(axis=1) if held is not None else np.zeros_like(border)


def _sums(values: NDArray[np.int64], edges: MeshEdges) -> NDArray[np.int64]:
    """Return the sums over the half-edges of each edge."""
    return np.add.reduceat(values, edges.starts) if edges.count else np.zeros(0, dtype=np.int64)


def _rooms(
    mesh: PolygonMesh, edges: MeshEdges, faces: NDArray[np.int64], held: NDArray[np.bool_] | None
) -> NDArray[np.int64]:
    """Return the room on each side of each face, first where its normal points to, shape (face_count, 2).

    Args:
        faces: of each half-edge.
    """
    number = np.repeat(np.arange(edges.count), edges.face_counts)
    order = np.lexsort((_turns(mesh, edges, faces, number), number))
    following = np.arange(len(order)) + 1
    following[edges.starts + edges.face_counts - 1] = edges.starts
    here, there = order, order[following]
    # Turning by the right hand about an edge, one leaves a face that runs along with it on the side of its normal.
    leaves = 2 * faces[here] + ~edges.forward[here]
    comes = 2 * faces[there] + edges.forward[there]
    way = ~_held_borders(edges, held)[number]
    return component_labels(2 * mesh.face_count, leaves[way], comes[way]).reshape(-1, 2)


def _turns(
    mesh: PolygonMesh, edges: MeshEdges, faces: NDArray[np.int64], number: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the angle of each half-edge's face about its edge, from the first face on it [rad]."""
    along = mesh.points[edges.ends[:, 1]] - mesh.points[edges.ends[:, 0]]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    runs = np.where(edges.forward[:, None], along[number], -along[number])
    into = np.cross(face_vector_areas(mesh)[faces], runs)
    into /= np.maximum(np.linalg.norm(into, axis=1, keepdims=True), 1e-300)
    ahead = into[np.repeat(edges.starts, edges.face_counts)]
    aside = np.cross(along[number], ahead)
    turns = np.arctan2((into * aside).sum(axis=1), (into * ahead).sum(axis=1))
    return np.where(turns < -1e-9, turns + 2.0 * np.pi, turns)


def _outside(mesh: PolygonMesh, rooms: NDArray[np.int64], parts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return a mask of the rooms that are outside, shape (2 * face_count,).

    Among connected rooms, it is that with the least volume around its faces, which is negative.
    """
    volumes = face_volumes(mesh)
    inside = np.bincount(rooms[:, 1], volumes, 2 * mesh.face_count)
    inside -= np.bincount(rooms[:, 0], volumes, 2 * mesh.face_count)
    numbers, first = np.unique(rooms, return_index=True)
    of_parts = parts[first // 2]
    order = np.lexsort((inside[numbers], of_parts))
    least = order[np.append(True, np.diff(of_parts[order]) != 0)]
    outside = np.zeros(2 * mesh.face_count, dtype=bool)
    outside[numbers[least]] = True
    return outside

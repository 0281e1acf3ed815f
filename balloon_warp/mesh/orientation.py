"""Consistent outward winding, and the side on which a pressure pushes the faces between inside and outside.

Faces that separate a mesh's inside from the outside, and the side on which a pressure pushes them.

A face has two sides. Around an edge its faces stand like pages around a spine, and the space between one and the next
sees a side of each: these sides are of one *room*. So they are where a border is free: there one goes around it. The
outside is a room, too. A face with the outside on one of its sides alone is pushed that way. One with the same on both,
as a sheet, a fin, a Moebius strip or the wall between two rooms, is not: then for any faces, those that are
pushed go all around something, so that the pressure is the gradient of a volume. It has no net force, and does no work
on the way around.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import (
    MeshEdges,
    border_edges,
    component_labels,
    corner_faces,
    face_areas,
    face_starts,
    face_vector_areas,
    face_volumes,
    flipped,
    inconsistent_edges,
    mesh_edges,
    next_corners,
    signed_volume,
    triangulate,
    vertex_components,
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


# A component encloses nothing below this part of its area to the power of 3/2: a rounding error of float64.
NO_VOLUME = 1e-12


def oriented_outward(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with neighboring faces wound alike, and outward on the whole, by the fewest flips."""
    mesh = wound_alike(mesh)
    return flipped(mesh, np.ones(mesh.face_count, dtype=bool)) if signed_volume(mesh) < 0.0 else mesh


def facing_outward(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with faces wound consistently, and closed components outward.

    Hollows in the largest component stay inward; and where three faces or more meet, those that are between the inside
    and the outside face outward.
    """
    mesh, _ = pushed_outward(wound_alike(mesh))
    inward = inward_faces(mesh, mesh_edges(mesh))
    return flipped(mesh, inward) if inward.any() else mesh


def inward_faces(mesh: PolygonMesh, edges: MeshEdges) -> NDArray[np.bool_]:
    """Return a mask of the faces of components that face their inside, shape (face_count,).

    A component has an inside if it is closed and consistently wound.

    A component that lies in the box around the largest outward one is a hollow in it: it faces inward rightly.
    """
    component = vertex_components(mesh, edges)
    of_faces = component[mesh.face_vertex_indices[face_starts(mesh)]]
    has_inside = np.ones(mesh.vertex_count, dtype=bool)
    for spoiled in (border_edges(edges), inconsistent_edges(edges)):
        has_inside[component[edges.ends[spoiled, 0]]] = False
    volumes = np.bincount(of_faces, face_volumes(mesh), mesh.vertex_count) * has_inside
    areas = np.bincount(of_faces, face_areas(mesh), mesh.vertex_count)
    inward = volumes < -NO_VOLUME * areas**1.5
    largest = int(volumes.argmax())
    if inward.any() and volumes[largest] > 0.0:
        box = mesh.points[component == largest]
        outside = ((mesh.points <= box.min(axis=0)) | (mesh.points >= box.max(axis=0))).any(axis=1)
        sticks_out = np.bincount(component, outside, mesh.vertex_count) > 0
        inward &= sticks_out
    return inward[of_faces]


def wound_alike(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with neighboring faces wound alike where possible, by the fewest flips."""
    edges = mesh_edges(mesh)
    if not len(inconsistent_edges(edges)):
        return mesh
    pairs = edges.starts[edges.face_counts == 2]
    face = corner_faces(mesh)[edges.corners]
    first, second = face[pairs], face[pairs + 1]
    # Each face stands for two nodes, as it is and turned over; nodes that are wound alike are connected.
    turned = (edges.forward[pairs] == edges.forward[pairs + 1]) * mesh.face_count
    labels = component_labels(
        2 * mesh.face_count,
        np.concatenate([first, first + mesh.face_count]),
        np.concatenate([second + turned, second + mesh.face_count - turned]),
    )
    as_is, as_turned = labels[: mesh.face_count], labels[mesh.face_count :]
    sizes = np.bincount(as_is, minlength=2 * mesh.face_count)
    flip = (sizes[as_turned] > sizes[as_is]) | ((sizes[as_turned] == sizes[as_is]) & (as_turned < as_is))
    return flipped(mesh, flip)


BESIDE = 8
"""Number of nearest edges considered for each edge"""
ACROSS = 0.4
"""Largest gap across a seam over an edge's length; beyond it an edge's neighbors are as near"""


class Pairs(NamedTuple):
    """Open edges that lie along each other, from end to end."""

    edges: NDArray[np.int64]
    """Numbers of two edges each, shape (n, 2)"""
    ends: NDArray[np.int64]
    """Vertices of both edges that lie beside each other, shape (n, 2, 2)"""
    gaps: NDArray[np.float64]
    """Larger of the two gaps, shape (n,)"""


@dataclass(frozen=True)
class Border:
    """The open edges of a mesh."""

    points: NDArray[np.float64]
    """Points of the mesh, shape (vertex_count, 3)"""
    ends: NDArray[np.int64]
    """Vertices of border edges, shape (n, 2)"""
    faces: NDArray[np.int64]
    """Faces of border edges, shape (n,)"""

    @classmethod
    def of(cls, mesh: PolygonMesh) -> Self:
        """Collect a mesh's open edges; each of its faces has its corners once."""
        edges = mesh_edges(mesh)
        border = border_edges(edges)
        return cls(mesh.points, edges.ends[border], corner_faces(mesh)[edges.corners[edges.starts[border]]])

    @property
    def lengths(self) -> NDArray[np.float64]:
        """Lengths of the edges, shape (n,)."""
        begin, end = np.moveaxis(self.points[self.ends], 1, 0)
        return np.linalg.norm(end - begin, axis=1)

    def pairs(self, reach: float, alike: float = 0.0, across: float = ACROSS) -> Pairs:
        """Find edges that lie along each other, of different faces.

        Args:
            reach: the widest gap.
            alike: up to this gap any two are a pair; with a wider one, two of which each is the other's nearest.
            across: of an edge's length is a gap at most.
        """
        count, lengths = len(self.ends), self.lengths
        bound = min(reach, across * lengths.max(initial=0.0))
        if count < 2 or not bound:
            return Pairs(np.zeros((0, 2), np.int64), np.zeros((0, 2, 2), np.int64), np.zeros(0))
        from scipy.spatial import KDTree  # takes long to load: only for open meshes

        middles = self.points[self.ends].mean(axis=1)
        found = KDTree(middles).query(middles, k=min(BESIDE, count), distance_upper_bound=np.nextafter(bound, np.inf))
        others = np.asarray(found[1])
        first, slot = np.nonzero(others < count)
        second = others[first, slot]
        straight, crossed = self._gaps(self.ends[second], first), self._gaps(self.ends[second, ::-1], first)
        gaps = np.minimum(straight, crossed)
        near = (gaps <= np.minimum(reach, across * np.minimum(lengths[first], lengths[second]))) & (
            self.faces[first] != self.faces[second]
        )
        first, second, gaps, turned = first[near], second[near], gaps[near], (crossed < straight)[near]
        nearest = np.full(count, -1)
        order = np.argsort(-gaps, kind="stable")
        nearest[first[order]] = second[order]
        taken = (gaps <= alike) | ((nearest[first] == second) & (nearest[second] == first))
        first, second, turned = first[taken], second[taken], turned[taken]
        other = np.where(turned[:, None], self.ends[second, ::-1], self.ends[second])
        return Pairs(np.stack([first, second], axis=1), np.stack([self.ends[first], other], axis=2), gaps[taken])

    def _gaps(self, others: NDArray[np.int64], edges: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the larger distance between the ends of each edge and of another, shape (n,)."""
        return np.linalg.norm(self.points[self.ends[edges]] - self.points[others], axis=2).max(axis=1, initial=0.0)


CREASE = 40.0
"""Angle between two faces' normals above which their edge is sharp, on rigid meshes [degrees]"""
SOFT_CREASE = 60.0
"""Angle above which an edge is sharp at the start on deformable meshes [degrees]: a balloon is rounder than its
faces"""


class Folds(NamedTuple):
    """Edges that two faces share, as the corner of each at which it begins there."""

    one: NDArray[np.integer]
    """Corners at the edges, shape (edge_count,)"""
    other: NDArray[np.integer]
    """Corners of the faces across the edges, shape (edge_count,)"""
    sharp: NDArray[np.bool_]
    """Mask of sharp edges, shape (edge_count,)"""


def find_folds(mesh: PolygonMesh, angle: float) -> Folds:
    """Find the edges that two faces share, and which of them are sharp.

    Sharp edges go around or from border to border. An edge that ends on a smooth face is a bump of a coarse mesh.

    Args:
        angle: between two faces' normals, beyond which their edge is sharp [degrees].
    """
    tails = mesh.face_vertex_indices
    ends = np.sort(np.stack([tails, tails[next_corners(mesh)]], axis=1), axis=1)
    order = np.lexsort(ends.T)
    one, other = order[:-1], order[1:]
    neighbors = (ends[one] == ends[other]).all(axis=1)
    alone = np.ones(len(ends), bool)
    alone[one[neighbors]] = alone[other[neighbors]] = False
    one, other = one[neighbors], other[neighbors]
    normals = face_vector_areas(mesh)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    faces = corner_faces(mesh)
    first, second = normals[faces[one]], normals[faces[other]]
    has_sides = first.any(axis=1) & second.any(axis=1)  # faces of no area have no side to be on
    sharp = has_sides & (np.einsum("ij,ij->i", first, second) < np.cos(np.radians(angle)))
    at_border = np.zeros(mesh.vertex_count, bool)
    at_border[ends[alone]] = True
    return Folds(one, other, _that_lead_on(sharp, ends[one], at_border))


def sharp_edges(mesh: PolygonMesh, angle: float) -> NDArray[np.int32]:
    """Find the vertices of each sharp edge, shape (n, 2); see `find_folds`."""
    found = find_folds(mesh, angle)
    tails, begins = mesh.face_vertex_indices, found.one[found.sharp]
    return np.stack([tails[begins], tails[next_corners(mesh)[begins]]], axis=1).astype(np.int32)


def _that_lead_on(sharp: NDArray[np.bool_], ends: NDArray[np.int32], at_border: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return a mask of the sharp edges that remain after dead ends are removed repeatedly."""
    remaining = sharp.copy()
    while True:
        degrees = np.bincount(ends[remaining].ravel(), minlength=len(at_border))
        loose = remaining & ((degrees == 1) & ~at_border)[ends].any(axis=1)
        if not loose.any():
            return remaining
        remaining &= ~loose


SHORTER = 1.0 - 1.0e-5
"""Ratio of diagonals above which they count as equal, and the first corner's is taken"""


def triangles_of(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Cut quads along their shorter diagonal, and others into fans from the first corner, shape (triangle_count, 3)."""
    corners = np.array(mesh.face_vertex_indices, dtype=np.int64)
    firsts = face_starts(mesh)[mesh.face_vertex_counts == 4]
    quads = corners[firsts[:, None] + np.arange(4)]
    ends = mesh.points[quads]
    first, second = (np.linalg.norm(ends[:, corner] - ends[:, corner + 2], axis=1) for corner in (0, 1))
    turned = second < SHORTER * first
    corners[firsts[turned, None] + np.arange(4)] = np.roll(quads[turned], -1, axis=1)
    cut = PolygonMesh(mesh.points, mesh.face_vertex_counts, corners.astype(np.int32))
    return triangulate(cut)[0].astype(np.int64).reshape(-1, 3)

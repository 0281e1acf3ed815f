"""Topology and geometry of a mesh: edges, borders, components and genus; areas, volume, normals and samples.

Areas, volume, normals and size of meshes; plain shapes, and samples of a surface.

Areas, volume and normals of polygon meshes, in float64 and in the unit of the mesh's points.

Faces may have any number of corners and need not be flat: a face's vector area, half the sum of the cross products of
its successive corners, does not depend on where the sum starts, and neither does the volume that follows from it.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
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


def face_centers(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return the mean of each face's corners, shape (face_count, 3)."""
    return _sum_over_faces(mesh, mesh.points[mesh.face_vertex_indices]) / mesh.face_vertex_counts[:, None]


def face_vector_areas(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return each face's area along its normal, 1/2 sum a x b over its edges a b, shape (face_count, 3)."""
    if _only_quads(mesh):
        return _vector_areas_of_quads(*_corners_of_quads(mesh))
    # Taken about the face's first corner, so that a small face far from the origin keeps its digits.
    first = mesh.points[mesh.face_vertex_indices[face_starts(mesh)]]
    arms = mesh.points[mesh.face_vertex_indices] - first[corner_faces(mesh)]
    return 0.5 * _sum_over_faces(mesh, np.cross(arms, arms[next_corners(mesh)]))


def face_areas(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return the length of each face's vector area, shape (face_count,)."""
    return np.linalg.norm(face_vector_areas(mesh), axis=1)


def total_area(mesh: PolygonMesh) -> float:
    """Sum of the face areas."""
    return float(face_areas(mesh).sum())


def vertex_areas(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return each vertex's share of the areas of its faces, which their corners have alike; shape (vertex_count,)."""
    shares = (face_areas(mesh) / mesh.face_vertex_counts)[corner_faces(mesh)]
    return np.bincount(mesh.face_vertex_indices, shares, mesh.vertex_count).astype(np.float64)


def vertex_vector_areas(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return each vertex's share of the vector areas of its faces, which their corners have alike; shape (n, 3).

    Where faces are flat and the mesh is closed this is the gradient of the volume.
    """
    shares = (face_vector_areas(mesh) / mesh.face_vertex_counts[:, None])[corner_faces(mesh)]
    sums = [np.bincount(mesh.face_vertex_indices, each, mesh.vertex_count).astype(np.float64) for each in shares.T]
    return np.stack(sums, axis=1)


def face_volumes(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return signed volumes of the cones from the mesh's center to each face, center . area / 3, shape (face_count,).

    A face counts as the fan of triangles about its center; for a quad that is the mean of its two triangulations.
    """
    return _volumes(mesh, face_centers(mesh), face_vector_areas(mesh))


def signed_volume(mesh: PolygonMesh) -> float:
    """Return the volume about the mesh's own center: positive where a closed mesh's faces wind outward."""
    return float(face_volumes(mesh).sum())


def volume_and_area(mesh: PolygonMesh) -> tuple[float, float]:
    """Return `signed_volume` and `total_area`, for little more than either takes."""
    if _only_quads(mesh):
        corners = _corners_of_quads(mesh)
        vector_areas, centers = _vector_areas_of_quads(*corners), [0.25 * sum(axis) for axis in corners]
        centers = np.stack(centers, axis=1)
    else:
        vector_areas, centers = face_vector_areas(mesh), face_centers(mesh)
    volume = _volumes(mesh, centers, vector_areas).sum()
    return float(volume), float(np.sqrt(_dot(vector_areas, vector_areas)).sum())


def vertex_normals(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return Gouraud normals, normalized means of the incident faces' unit normals, shape (vertex_count, 3).

    Faces of no area add nothing; a vertex without any other face gets the zero vector.
    """
    face_normals = _normalized(face_vector_areas(mesh))
    sums = np.zeros((mesh.vertex_count, 3))
    np.add.at(sums, mesh.face_vertex_indices, face_normals[corner_faces(mesh)])
    return _normalized(sums)


def triangulate(mesh: PolygonMesh) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the fans of triangles from each face's first corner.

    Returns:
        The triangles' corners, shape (triangle_count, 3), and the face of each triangle, shape (triangle_count,).
    """
    per_face = mesh.face_vertex_counts - 2
    face = np.repeat(np.arange(mesh.face_count), per_face)
    place = np.arange(len(face)) - np.repeat(np.cumsum(per_face) - per_face, per_face)
    start = face_starts(mesh)[face]
    corners = np.stack([start, start + place + 1, start + place + 2], axis=1)
    return mesh.face_vertex_indices[corners].astype(np.int32), face.astype(np.int32)


def first_coincident(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return, for each point, the lowest number of a point at exactly the same place, shape (point_count,)."""
    order = np.lexsort(points.T)
    ordered = points[order]
    begins = np.ones(len(points), dtype=bool)
    begins[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    # lexsort is stable: the first of each run is its lowest number.
    first = np.empty(len(points), dtype=np.int64)
    first[order] = order[begins][np.cumsum(begins) - 1]
    return first


def _volumes(mesh: PolygonMesh, centers: NDArray[np.float64], vector_areas: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the volumes of the cones from the mean of all faces' corners."""
    middle = np.average(centers, axis=0, weights=mesh.face_vertex_counts) if len(centers) else np.zeros(3)
    return _dot(centers - middle, vector_areas) / 3.0


def _only_quads(mesh: PolygonMesh) -> bool:
    return mesh.face_count > 0 and bool((mesh.face_vertex_counts == 4).all())


def _corners_of_quads(mesh: PolygonMesh) -> list[list[NDArray[np.float64]]]:
    """Return coordinates of quads' corners by axis and corner, each of shape (face_count,).

    Contiguous numbers are several times as fast as vectors.
    """
    corners = np.ascontiguousarray(mesh.face_vertex_indices.reshape(-1, 4).T, dtype=np.intp)
    return [[values[corner] for corner in corners] for values in np.ascontiguousarray(mesh.points.T)]


def _vector_areas_of_quads(*axes: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return half the cross products of the diagonals: of differences, as above."""
    (ax, bx), (ay, by), (az, bz) = ((third - first, fourth - second) for first, second, third, fourth in axes)
    return 0.5 * np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.einsum("ij,ij->i", a, b)


def _sum_over_faces(mesh: PolygonMesh, at_corners: NDArray[np.float64]) -> NDArray[np.float64]:
    if mesh.face_count == 0:
        return np.zeros((0, at_corners.shape[1]))
    if (mesh.face_vertex_counts == mesh.face_vertex_counts[0]).all():
        size = int(mesh.face_vertex_counts[0])
        return sum((at_corners[corner::size] for corner in range(1, size)), start=at_corners[::size])
    return np.add.reduceat(at_corners, face_starts(mesh), axis=0)


def _normalized(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0.0)


LEAST_SIZE, LARGEST_SIZE = 1.0e-6, 1.0e9
"""Range of the size of a balloon [m]"""
LEAST_SIZE_OVER_DISTANCE = 1.0e-4
"""Least size of a balloon over its distance from the origin: float32 then resolves a thousandth of it"""


def require_size(mesh: PolygonMesh, source: object) -> None:
    """Refuse meshes that float32 cannot simulate: extreme sizes, and positions far from the origin for their size.

    Args:
        mesh: in the world [m].

    Raises:
        InputError: names `source`, the size, and the expected one.
    """
    size = float(np.ptp(mesh.points[mesh.face_vertex_indices], axis=0).max())
    if not LEAST_SIZE <= size <= LARGEST_SIZE:
        expected = f"expected {LEAST_SIZE:g} to {LARGEST_SIZE:g} m; balloon.scale changes it"
        raise InputError(f"{source}: is {size:g} m across; {expected}")
    require_reach(mesh, source, box_corners(mesh))


def box_corners(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return the corners of the box around the mesh's faces, along the axes, shape (8, 3)."""
    points = mesh.points[mesh.face_vertex_indices]
    ends = np.stack([points.min(axis=0), points.max(axis=0)])
    return np.array([[ends[x, 0], ends[y, 1], ends[z, 2]] for x in (0, 1) for y in (0, 1) for z in (0, 1)])


def require_reach(mesh: PolygonMesh, source: object, corners: NDArray[np.float64]) -> None:
    """Make sure that float32 resolves the balloon wherever a world puts it.

    Args:
        corners: of the box around it, there [m], shape (..., 3).

    Raises:
        InputError: it does not.
    """
    size = float(np.ptp(mesh.points[mesh.face_vertex_indices], axis=0).max())
    reach = float(np.abs(corners).max())
    if size < LEAST_SIZE_OVER_DISTANCE * reach:
        raise InputError(
            f"{source}: is {size:g} m across and {reach:g} m from the origin, too far for 32-bit floats; "
            "balloon.position moves it closer"
        )


AROUND = 32
"""Number of quads around an axis, even: at a pole two triangles are one quad"""
RINGS = 8
"""Number of quads from a pole of a sphere to its equator"""
MOST_RINGS = 256
"""Largest number of rings along a straight line"""


class Faces(NamedTuple):
    """A surface, without a name or a unit."""

    points: NDArray[np.float64]
    """Points, shape (n, 3)"""
    counts: NDArray[np.int32]
    """Corners of each face"""
    indices: NDArray[np.int32]
    """Point of each corner, counter-clockwise from outside"""


def box_faces(size: float) -> Faces:
    """Return a cube of six faces."""
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Faces(size * corners, np.full(6, 4, np.int32), np.array(sides, np.int32).ravel())


def rectangle_faces(width: float, length: float, axis: int) -> Faces:
    """Return a rectangle of one face that looks along an axis, as USD's Plane lies."""
    across, along = np.eye(3)[[2, 0, 0][axis]], np.eye(3)[[1, 2, 1][axis]]
    corners = 0.5 * np.array([-1, 1, 1, -1])[:, None] * width * across
    corners = corners + 0.5 * np.array([-1, -1, 1, 1])[:, None] * length * along
    turned = np.cross(across, along)[axis] < 0.0
    return Faces(corners, np.full(1, 4, np.int32), np.array([3, 2, 1, 0] if turned else [0, 1, 2, 3], np.int32))


def capsule_faces(radii: tuple[float, float], height: float, axis: int) -> Faces:
    """Return a capsule: round ends of radii, first of the upper one, whose centers are a height apart."""
    polar = np.linspace(0.0, 0.5 * np.pi, RINGS + 1)
    upper = np.stack([radii[0] * np.cos(polar) + 0.5 * height, radii[0] * np.sin(polar)], axis=1)
    lower = np.stack([-radii[1] * np.cos(polar) - 0.5 * height, radii[1] * np.sin(polar)], axis=1)[::-1]
    return _revolved(np.concatenate([upper, _between(upper[-1], lower[0]), lower[height == 0.0 :]]), axis)


def cylinder_faces(radii: tuple[float, float], height: float, axis: int) -> Faces:
    """Return a closed cylinder, or a cone where the upper or the lower of its radii is 0."""
    profile = 0.5 * height * np.array([1.0, 1.0, -1.0, -1.0])
    corners = np.stack([profile, [0.0, *radii, 0.0]], axis=1)
    distinct = corners[np.append(True, np.any(np.diff(corners, axis=0) != 0.0, axis=1))]
    pieces = [np.vstack([begin, _between(begin, end)]) for begin, end in pairwise(distinct)]
    return _revolved(np.concatenate([*pieces, distinct[-1:]]), axis)


def _between(begin: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the places between two corners of a profile that make its quads about as long as wide."""
    wide = 2.0 * np.pi * max(begin[1], end[1]) / AROUND
    count = int(np.clip(np.ceil(np.linalg.norm(end - begin) / wide), 1, MOST_RINGS)) if wide > 0.0 else 1
    return np.linspace(begin, end, count + 1)[1:-1]


def _revolved(profile: NDArray[np.float64], axis: int) -> Faces:
    """Return the surface that a profile goes through around an axis.

    Args:
        profile: places along the axis and distances from it, from the upper pole to the lower, shape (n, 2).
        axis: 0, 1 or 2 for X, Y or Z.
    """
    turn = 2.0 * np.pi * np.arange(AROUND) / AROUND
    along, out = np.repeat(profile[1:-1, 0], AROUND), profile[1:-1, 1:]
    # along, and two across: a right-handed frame
    rings = np.stack([along, (out * np.cos(turn)).ravel(), (out * np.sin(turn)).ravel()], axis=1)
    points = np.concatenate([rings, [[profile[0, 0], 0.0, 0.0], [profile[-1, 0], 0.0, 0.0]]])
    here = np.arange(AROUND)
    after = (here + 1) % AROUND
    starts = AROUND * np.arange(len(profile) - 3)[:, None]
    quads = np.stack([starts + here, starts + AROUND + here, starts + AROUND + after, starts + after], axis=-1)
    bottom, two = len(rings) - AROUND, here[::2]
    pole = np.ones_like(two)
    caps = [
        np.stack([len(rings) * pole, two, two + 1, (two + 2) % AROUND], axis=1),
        np.stack([(len(rings) + 1) * pole, bottom + (two + 2) % AROUND, bottom + two + 1, bottom + two], axis=1),
    ]
    indices = np.concatenate([quads.reshape(-1, 4), *caps]).astype(np.int32)
    return Faces(np.roll(points, axis, axis=1), np.full(len(indices), 4, np.int32), indices.ravel())


def quad_sphere(cells: int, radius: float) -> PolygonMesh:
    """Return a cube of cells by cells quads a side, blown up to a sphere: 6 cells^2 + 2 vertices, winding outward."""
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij"))
    square = np.stack([[i, i + 1, i + 1, i], [j, j, j + 1, j + 1]])  # (axis, corner, quad)
    corners = []
    for axis in range(3):
        for side in (0, cells):
            quads = np.empty((*square.shape[1:], 3), dtype=np.int64)
            quads[..., axis] = side
            quads[..., (axis + 1) % 3], quads[..., (axis + 2) % 3] = square
            corners.append((quads if side else quads[::-1]).transpose(1, 0, 2))
    places, indices = np.unique(np.concatenate(corners).reshape(-1, 3), axis=0, return_inverse=True)
    points = np.tan((2.0 * places / cells - 1.0) * np.pi / 4.0)  # equal angles, which keeps the quads even
    return PolygonMesh(
        points=radius * points / np.linalg.norm(points, axis=1, keepdims=True),
        face_vertex_counts=np.full(6 * cells**2, 4, dtype=np.int32),
        face_vertex_indices=indices.ravel().astype(np.int32),
        name="balloon",
    )


def even_samples(mesh: PolygonMesh, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.integer]]:
    """Return samples of the surface, shape (count, 3), their normals, and the vertices next to them, shape (count,).

    As many for each triangle as its area has, in a fixed order (the golden ratio's, within a triangle).
    """
    triangles, _ = triangulate(mesh)
    corners = mesh.points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    ends = np.cumsum(areas) / areas.sum()
    places = (np.arange(count) + 0.5) / count
    chosen = np.minimum(np.searchsorted(ends, places), len(areas) - 1)
    u, v = (places * count * 0.7548776662) % 1.0, (places * count * 0.5698402910) % 1.0
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    weights = np.stack([1.0 - u - v, u, v], axis=1)
    points = np.einsum("nc,nci->ni", weights, corners[chosen])
    nearest = triangles[chosen, weights.argmax(axis=1)]
    return points, normals[chosen] / areas[chosen, None], nearest

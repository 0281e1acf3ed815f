"""Areas, volume and normals of polygon meshes, in float64 and in the unit of the mesh's points.

Faces may have any number of corners and need not be flat: a face's vector area, half the sum of the cross products of
its successive corners, does not depend on where the sum starts, and neither does the volume that follows from it.
"""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.corners import corner_faces, face_starts, next_corners
from balloon_warp.mesh.polygon_mesh import PolygonMesh


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

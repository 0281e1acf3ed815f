"""Depth of particles in balloons, found on the host by another method than the simulation's."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from balloon_warp.mesh import PolygonMesh

Points = NDArray[np.float64]


def deepest_overlap(parts: Sequence[Points], meshes: Sequence[PolygonMesh]) -> float:
    """Return the largest distance of a particle within another balloon from its surface [m]; 0 if none is in any.

    Args:
        parts: the particles of each balloon.
        meshes: whose faces they have.
    """
    surfaces = [surface(replace(mesh, points=part)) for mesh, part in zip(meshes, parts, strict=True)]
    lower, upper = (np.array([bound(part, axis=0) for part in parts]) for bound in (np.min, np.max))
    near = ((lower[:, None] < upper[None]) & (lower[None] < upper[:, None])).all(axis=2)
    pairs = np.argwhere(near & ~np.eye(len(parts), dtype=bool)).tolist()
    return max((depth(parts[own], surfaces[other]) for own, other in pairs), default=0.0)


def deepest_in_itself(points: Points, mesh: PolygonMesh, apart: float) -> float:
    """Return the largest distance of a particle within another part of its balloon from its surface [m].

    The surface winds around it once more than around particles on it.

    Args:
        points: of its particles.
        mesh: at the start.
        apart: least distance at the start from a particle to all corners of a face that it may touch [m].
    """
    triangles, corners = surface(replace(mesh, points=points)), mesh.points[mesh.face_vertex_indices]
    counts = mesh.face_vertex_counts
    begins = np.cumsum([0, *counts[:-1]])
    inside = np.concatenate([winding(some, triangles) > 1.2 for some in np.array_split(points, len(points) // 100 + 1)])
    depths = []
    for number in np.flatnonzero(inside):
        nearest = np.minimum.reduceat(np.linalg.norm(corners - mesh.points[number], axis=1), begins)
        depths.append(float(distances(points[number], triangles[np.repeat(nearest, counts) >= apart]).min()))
    return max(depths, default=0.0)


def surface(mesh: PolygonMesh) -> Points:
    """Return the faces of a mesh as fans about their centers, shape (triangles, 3, 3)."""
    triangles = []
    for face in np.split(mesh.face_vertex_indices, np.cumsum(mesh.face_vertex_counts)[:-1]):
        center = mesh.points[face].mean(axis=0)
        triangles += [(mesh.points[a], mesh.points[b], center) for a, b in zip(np.roll(face, 1), face, strict=True)]
    return np.array(triangles)


def depth(points: Points, triangles: Points) -> float:
    """Return the largest distance from a closed surface of the points that it winds around [m]."""
    near = ((points > triangles.min(axis=(0, 1))) & (points < triangles.max(axis=(0, 1)))).all(axis=1)
    inside = points[near][winding(points[near], triangles) > 0.5]
    return max((float(distances(point, triangles).min()) for point in inside), default=0.0)


def dot(u: Points, v: Points) -> Points:
    """Return the dot product over the last dimension."""
    return (u * v).sum(axis=-1)


def winding(points: Points, triangles: Points) -> Points:
    """Return the surface's winding number about each point: solid angles over 4 pi (van Oosterom and Strackee 1983)."""
    a, b, c = triangles.swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    height = dot(a, normals) - points @ normals.T  # times twice the area: the triple product of the arms
    la, lb, lc = (cdist(points, corners) for corners in (a, b, c))
    ab, bc, ca = (0.5 * dot(edge, edge) for edge in (b - a, c - b, a - c))  # |a|^2 + |b|^2 = 2 a . b + |b - a|^2
    sa, sb, sc = (0.5 * length * length for length in (la, lb, lc))
    below = la * lb * lc + (sa + sb - ab) * lc + (sb + sc - bc) * la + (sc + sa - ca) * lb
    is_corner = np.minimum(np.minimum(la, lb), lc) == 0.0
    return np.where(is_corner, 0.0, np.arctan2(height, below)).sum(axis=1) / (2.0 * np.pi)


def distances(point: Points, triangles: Points) -> Points:
    """Return the distance from a point to each triangle [m]: to its plane, if the point is above it, or its edges."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    above = np.ones(len(triangles), dtype=bool)
    nearest = np.full(len(triangles), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge = end - start
        part = ((point - start) * edge).sum(axis=1) / np.maximum((edge**2).sum(axis=1), 1e-300)
        foot = start + np.clip(part, 0.0, 1.0)[:, None] * edge
        nearest = np.minimum(nearest, np.linalg.norm(point - foot, axis=1))
        above &= (np.cross(edge, point - start) * normal).sum(axis=1) >= 0.0
    return np.where(above, np.abs(((point - a) * normal).sum(axis=1)), nearest)

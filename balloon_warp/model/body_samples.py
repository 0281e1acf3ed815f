"""Sample points of free bodies and of obstacles that are held out of other solids.

Each is the center of a little ball inside that touches the surface there, so that for two solids edge on edge it is
clear which faces touch. Host side, float64.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.model.obstacles import ObstacleShape

MOST_SAMPLES = 1024
"""Largest number of a mesh's vertices that become samples"""
SIDE_SAMPLES = 5
"""Number of samples along an edge of a box"""
ROUNDED_BOX = 0.01
"""Radius of a box's balls over half the shortest edge"""
ROUNDED_MESH = 0.002
"""Radius of a mesh's balls over the mesh's extent"""
FARTHEST_IN = 4.0
"""Largest depth of a ball at a sharp vertex, in radii"""


@dataclass(frozen=True)
class Samples:
    """Samples of a body about its center of mass, or of an obstacle about its origin."""

    points: NDArray[np.float64]
    """Centers of the balls, and their radii, shape (n, 4)"""
    outermost: int
    """Number of the first samples that suffice on something flat"""
    at_edges: int
    """Number of the first samples that suffice on something with samples of its own"""


def sample(solid: ObstacleShape, up: NDArray[np.float64]) -> Samples:
    """Return the samples of a shape; a plane has none."""
    if solid.kind == "box":
        return _of_box(solid)
    if solid.kind == "capsule":
        return _of_capsule(solid, up)
    if solid.kind == "plane":
        return Samples(np.zeros((0, 4)), 0, 0)
    return _of_mesh(solid)


def _of_box(solid: ObstacleShape) -> Samples:
    steps = np.linspace(-1.0, 1.0, SIDE_SAMPLES)
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    sides = (np.abs(grid) == 1.0).sum(axis=1)
    order = np.argsort(-sides, kind="stable")[: int((sides > 0).sum())]
    radius = ROUNDED_BOX * float(solid.size.min())
    points = grid[order] * (solid.size - radius)
    return Samples(_balls(points, radius + solid.thickness), int((sides == 3).sum()), int((sides >= 2).sum()))


def _of_capsule(solid: ObstacleShape, up: NDArray[np.float64]) -> Samples:
    """Return samples along a capsule's axis, its ends first.

    They are no further apart than its radius, except in very long ones.
    """
    radius, half = float(solid.size[0]), float(solid.size[1])
    count = int(min(np.ceil(2.0 * half / radius) + 1, 33)) if half > 0.0 else 1
    places = np.linspace(-half, half, count) if count > 1 else np.zeros(1)
    places = places[np.argsort(-np.abs(places), kind="stable")]
    return Samples(_balls(np.outer(places, up), radius + solid.thickness), min(count, 2), count)


def _of_mesh(solid: ObstacleShape) -> Samples:
    """Return some of a mesh's vertices as samples, those of its convex hull first: on something flat it stands on them.

    Of many vertices all that are on the hull are chosen, and of the others those far from each other.
    """
    from scipy.spatial import ConvexHull, QhullError  # takes long to load

    assert solid.mesh is not None  # as its kind says
    points, used = solid.mesh.points, np.unique(solid.mesh.face_vertex_indices)
    try:
        hull = used[np.sort(ConvexHull(points[used]).vertices)]
    except QhullError:  # it is flat
        hull = used
    first = _spread(points, hull, hull[:0])
    rest = np.setdiff1d(used, hull)
    chosen = np.concatenate([first, _spread(points, rest, first)])
    balls, radii = points[chosen], np.zeros(len(chosen))
    if solid.closed:
        balls, radii = _rounded(solid, chosen)
    return Samples(_balls(balls, radii + solid.thickness), len(first), len(chosen))


def _rounded(solid: ObstacleShape, chosen: NDArray[np.integer]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return balls inside that touch all faces at some vertices, of zero radius where there is no room."""
    from balloon_warp.mesh.mesh_distance import MeshDistance  # takes long to load

    assert solid.mesh is not None
    points, triangles = solid.mesh.points, solid.triangles
    radius = ROUNDED_MESH * solid.reach
    corners = points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    normals = np.divide(normals, areas[:, None], out=np.zeros_like(normals), where=areas[:, None] > 0.0)
    matrices, sums = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3))
    for column in triangles.T:
        np.add.at(matrices, column, areas[:, None, None] * normals[:, :, None] * normals[:, None, :])
        np.add.at(sums, column, areas[:, None] * normals)
    ways = -radius * np.einsum("nij,nj->ni", np.linalg.pinv(matrices, rcond=1.0e-3, hermitian=True), sums)
    depths = np.full(len(points), radius)  # of the balls' centers, below the nearest face
    for column in triangles.T:
        np.minimum.at(depths, column, -np.einsum("ni,ni->n", ways[column], normals))
    centers, depths = (points + ways)[chosen], depths[chosen]
    with wp.ScopedDevice("cpu"):
        inside = -MeshDistance(points, triangles, thickness=0.0)(centers)
    fits = (depths > 0.0) & (inside > 0.99 * depths)
    fits &= np.linalg.norm(ways[chosen], axis=1) <= FARTHEST_IN * radius
    return np.where(fits[:, None], centers, points[chosen]), np.where(fits, depths, 0.0)


def _balls(points: NDArray[np.float64], radii: NDArray[np.float64] | float) -> NDArray[np.float64]:
    return np.concatenate([points, np.broadcast_to(np.reshape(radii, (-1, 1)), (len(points), 1))], axis=1)


def _spread(
    points: NDArray[np.float64], among: NDArray[np.integer], before: NDArray[np.integer]
) -> NDArray[np.integer]:
    """Return as many of some points as there is room for, each as far as possible from those before it."""
    room = MOST_SAMPLES - len(before)
    if len(among) <= room:
        return among
    places = points[among]
    chosen = [] if len(before) else [int(np.linalg.norm(places, axis=1).argmax())]
    distances = np.full(len(among), np.inf)
    for place in (*points[before], *places[chosen]):
        distances = np.minimum(distances, np.linalg.norm(places - place, axis=1))
    while len(chosen) < room:
        chosen.append(int(distances.argmax()))
        distances = np.minimum(distances, np.linalg.norm(places - places[chosen[-1]], axis=1))
    return among[chosen]

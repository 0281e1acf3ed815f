"""Signed distances of simple solids, and their smooth unions, in float64; and solids of cubes.

Points have shape (n, 3), distances (n,), negative inside. An ellipsoid's distance, and a smooth union's, is exact only
in its zero level. After Inigo Quilez, "Distance functions", https://iquilezles.org/articles/distfunctions.
"""

from functools import reduce
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from balloon_warp.mesh.polygon_mesh import PolygonMesh

Points = NDArray[np.float64]
Distances = NDArray[np.float64]


def ellipsoid(points: Points, center: ArrayLike, radii: ArrayLike) -> Distances:
    """Return an ellipsoid along the axes; a sphere where the radii are one number."""
    radii = np.broadcast_to(np.asarray(radii, dtype=np.float64), 3)
    arm = points - np.asarray(center)
    scaled = np.linalg.norm(arm / radii, axis=1)
    slope = np.linalg.norm(arm / radii**2, axis=1)
    # At the very center both vanish.
    return np.where(slope > 1e-9, scaled * (scaled - 1.0) / np.maximum(slope, 1e-9), -radii.min())


def round_cone(points: Points, a: ArrayLike, b: ArrayLike, radius_a: float, radius_b: float) -> Distances:
    """Return the hull of two spheres, neither inside the other; a capsule where the radii are alike."""
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    length = float(np.linalg.norm(b - a))
    axis = (b - a) / length
    along = (points - a) @ axis
    across = np.linalg.norm(points - a - along[:, None] * axis, axis=1)
    # In the half-plane of axis and point, the side is a line at this slant to the axis.
    sine = (radius_a - radius_b) / length
    cosine = np.sqrt(1.0 - sine * sine)
    foot = along * cosine - across * sine
    side = along * sine + across * cosine - radius_a
    end_a = np.hypot(along, across) - radius_a
    end_b = np.hypot(along - length, across) - radius_b
    return np.where(foot < 0.0, end_a, np.where(foot > length * cosine, end_b, side))


def torus(points: Points, center: ArrayLike, radius: float, tube_radius: float) -> Distances:
    """Return a ring about the y axis."""
    x, y, z = (points - np.asarray(center)).T
    return np.hypot(np.hypot(x, z) - radius, y) - tube_radius


def cubes(filled: NDArray[np.bool_]) -> PolygonMesh:
    """Return the surface of the filled cells in a grid of unit cubes."""
    quads = []
    for axis in range(3):
        across, along = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
        for side in (0, 1):
            beyond = np.roll(np.pad(filled, 1), -1 if side else 1, axis)[1:-1, 1:-1, 1:-1]
            corner = np.argwhere(filled & ~beyond) + side * np.eye(3, dtype=int)[axis]
            quad = np.stack([corner, corner + across, corner + across + along, corner + along], axis=1)
            quads.append(quad if side else quad[:, ::-1])  # they look outward
    places, indices = np.unique(np.concatenate(quads).reshape(-1, 3), axis=0, return_inverse=True)
    return PolygonMesh(
        points=places.astype(np.float64),
        face_vertex_counts=np.full(len(indices.ravel()) // 4, 4, dtype=np.int32),
        face_vertex_indices=indices.ravel().astype(np.int32),
    )


def smooth_union(blend: float, *distances: Distances) -> Distances:
    """Return the union of solids, with fillets about as wide as `blend`."""

    def join(a: Distances, b: Distances) -> Distances:
        overlap = np.maximum(blend - np.abs(a - b), 0.0) / blend
        return np.minimum(a, b) - 0.25 * blend * overlap * overlap

    return reduce(join, distances)


def tube(points: Points, path: ArrayLike, radii: ArrayLike) -> Distances:
    """Return a tube of changing radius along a smooth curve through the points of a path (a Catmull-Rom spline).

    Args:
        points: where, shape (n, 3).
        path: points of the curve, shape (k, 3).
        radii: radius at each of them, shape (k,). It may change by less than the distance along the curve.
    """
    centers = _catmull_rom(np.column_stack([path, radii]))
    return reduce(np.minimum, (round_cone(points, a[:3], b[:3], a[3], b[3]) for a, b in pairwise(centers)))


def _catmull_rom(knots: NDArray[np.float64], steps: int = 4) -> NDArray[np.float64]:
    """Points on the spline through `knots`, `steps` to a span, ends included."""
    ends = [2.0 * knots[0] - knots[1]], [2.0 * knots[-1] - knots[-2]]
    padded = np.concatenate([ends[0], knots, ends[1]])
    t = np.arange(steps)[:, None] / steps
    spans = [
        0.5 * (2.0 * b + (c - a) * t + (2.0 * a - 5.0 * b + 4.0 * c - d) * t**2 + (3.0 * b - a - 3.0 * c + d) * t**3)
        for a, b, c, d in zip(padded, padded[1:], padded[2:], padded[3:], strict=False)
    ]
    return np.concatenate([*spans, knots[-1:]])


def mirrored(points: Points) -> Points:
    """Points folded onto the side of positive x, so that a solid there stands on both sides."""
    return np.abs(points) * [1.0, 0.0, 0.0] + points * [0.0, 1.0, 1.0]

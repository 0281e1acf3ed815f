"""Interpenetration of a simulation's balloons."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from balloon_warp.benchmarks.overlap import Points, deepest_overlap, dot, surface
from balloon_warp.mesh import PolygonMesh
from balloon_warp.simulator import Simulator


def deepest(simulator: Simulator, world: int = 0) -> float:
    """Return the largest distance of a particle within another balloon from its surface [m]; 0 if none is in any."""
    points = simulator.state.points.numpy()[world].astype(np.float64)
    parts = [points[begin:end] for begin, end in pairwise(simulator.model.particle_offsets)]
    return deepest_overlap(parts, [shape.mesh for shape in simulator.model.shapes])


def edges_through(points: Points, ends: NDArray[np.int64], mesh: PolygonMesh) -> int:
    """Return the number of edges of one balloon that pierce faces of another (Möller and Trumbore 1997).

    Args: points: particles of the first balloon. ends: its edges, shape (E, 2). mesh: the other balloon."""
    triangles, count = surface(mesh), 0
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    for begin, end in points[ends]:
        across, start = np.cross(end - begin, second), begin - triangles[:, 0]
        whole = dot(first, across)
        whole = np.where(np.abs(whole) > 1e-15, whole, np.inf)
        beside = np.cross(start, first)
        u, v, part = dot(start, across) / whole, (beside @ (end - begin)) / whole, dot(beside, second) / whole
        count += bool(((u > 0.0) & (v > 0.0) & (u + v < 1.0) & (part > 0.0) & (part < 1.0)).any())
    return count

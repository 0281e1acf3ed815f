"""How deep particles of a simulation are in other balloons, and in other parts of their own."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from balloon_warp.benchmarks.overlap import Points, deepest_overlap, distances, surface, winding
from balloon_warp.mesh import PolygonMesh
from balloon_warp.simulator import Simulator


def deepest(simulator: Simulator, world: int = 0) -> float:
    """How far the particle that is deepest in another balloon is from that one's surface [m]; 0 if none is in any."""
    points = simulator.state.points.numpy()[world].astype(np.float64)
    parts = [points[begin:end] for begin, end in pairwise(simulator.model.particle_offsets)]
    return deepest_overlap(parts, [shape.mesh for shape in simulator.model.shapes])


def deepest_in_itself(points: Points, mesh: PolygonMesh, apart: float) -> float:
    """How far the particle of a balloon that is deepest in another part of it is from that [m]: what its surface winds
    around once more than around those on it.

    Args:
        points: of its particles.
        mesh: at the start.
        apart: from a particle to other parts at the start, at least [m].
    """
    triangles, centers = surface(replace(mesh, points=points)), surface(mesh).mean(axis=1)
    inside = np.concatenate([winding(some, triangles) > 1.2 for some in np.array_split(points, len(points) // 100 + 1)])
    depths = [
        distances(points[number], triangles[np.linalg.norm(centers - mesh.points[number], axis=1) > apart]).min()
        for number in np.flatnonzero(inside)
    ]
    return max(depths, default=0.0)

"""How deep particles of a simulation are in other balloons."""

from itertools import pairwise

import numpy as np

from balloon_warp.benchmarks.overlap import deepest_overlap
from balloon_warp.simulator import Simulator


def deepest(simulator: Simulator, world: int = 0) -> float:
    """How far the particle that is deepest in another balloon is from that one's surface [m]; 0 if none is in any."""
    points = simulator.state.points.numpy()[world].astype(np.float64)
    parts = [points[begin:end] for begin, end in pairwise(simulator.model.particle_offsets)]
    return deepest_overlap(parts, [shape.mesh for shape in simulator.model.shapes])

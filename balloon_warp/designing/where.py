"""Places where a design falls short, in sentences."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.designing.measure import Ruler
from balloon_warp.mesh.components import component_labels
from balloon_warp.mesh.topology import mesh_edges

Values = NDArray[np.float64]
FAR = 0.02
"""Distance over the size beyond which a vertex counts as misplaced"""
MOST_PLACES = 4
LEAST_VERTICES = 3
FLAT = 0.5
"""Curvature over that of a sphere of the shape's size below which a region is flat"""
SIDES = (("left", "right"), ("bottom", "top"), ("back", "front"))


def places_off(ruler: Ruler, points: Values, help_: str = "") -> list[str]:
    """Return the places where a shape is off by more than `FAR`, the worst first, a sentence each.

    Args:
        points: of the shape [m], shape (n, 3).
        help_: remedy, at the end of each sentence.
    """
    off = np.linalg.norm(ruler.aligned(points) - ruler.mesh.points, axis=1) / ruler.size
    normal = np.abs(((ruler.aligned(points) - ruler.mesh.points) * ruler.normals).sum(axis=1)) / ruler.size
    far = normal > FAR
    ends = mesh_edges(ruler.mesh).ends
    both = far[ends].all(axis=1)
    labels = component_labels(len(off), ends[both, 0], ends[both, 1])
    groups = [np.flatnonzero((labels == label) & far) for label in np.unique(labels[far])]
    groups = sorted((group for group in groups if len(group) >= LEAST_VERTICES), key=lambda group: -normal[group].max())
    return [_sentence(ruler, group, float(normal[group].max()), help_) for group in groups[:MOST_PLACES]]


def _sentence(ruler: Ruler, group: NDArray[np.int64], worst: float, help_: str) -> str:
    middle = ruler.mesh.points[group].mean(axis=0)
    axis = int(np.abs(middle / np.ptp(ruler.mesh.points, axis=0)).argmax())
    side = SIDES[axis][int(middle[axis] > 0.0)]
    flat = ", flat" if _curvature(ruler, group) < FLAT else ""
    return f"the {side} ({len(group)} vertices{flat}) is off by {100.0 * worst:.2g}% of the size{help_}"


def _curvature(ruler: Ruler, group: NDArray[np.int64]) -> float:
    """Return the curvature of a group of vertices over that of a sphere of the shape's size."""
    places, normals = ruler.mesh.points[group], ruler.normals[group]
    reach = np.linalg.norm(places - places.mean(axis=0), axis=1).mean()
    turn = np.linalg.norm(normals - normals.mean(axis=0), axis=1).mean()
    return float(turn / max(reach, 1e-12) * 0.5 * ruler.size)

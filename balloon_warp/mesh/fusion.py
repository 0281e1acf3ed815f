"""Parts of a surface that its quads fuse or lose, in sentences."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from balloon_warp.mesh.fidelity import NEAR, SPECK, place_said, samples_of_parts
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import mesh_edges, vertex_components

NAMED = 6
"""Number of parts that a sentence names at most"""


def fusions_said(surface: PolygonMesh, result: PolygonMesh, cell: float) -> list[str]:
    """Return a sentence for each component of the result that several parts have become, and one of those within it.

    A part is a group's name, where it is all of that group, or its size and middle in the file's unit. Specks are left
    out.

    Args:
        surface: Source surface.
        result: Mesh that stands for it, whose vertices all belong to faces.
        cell: Width of a grid cell.
    """
    points, parts = samples_of_parts(surface)
    count = int(parts.max()) + 1
    if count == 1:
        return []
    labels = vertex_components(result, mesh_edges(result))
    away, which = map(np.asarray, KDTree(result.points).query(points))
    near = away <= NEAR * cell
    became: dict[int, list[int]] = {}
    inside = []
    for part in range(count):
        own = parts == part
        if np.linalg.norm(np.ptp(points[own], axis=0)) <= SPECK * cell:
            continue
        if not (own & near).any():
            inside.append(part)
            continue
        components, votes = np.unique(labels[which[own & near]], return_counts=True)
        became.setdefault(int(components[votes.argmax()]), []).append(part)
    said = [
        f"{_named(surface, points, parts, fused)} became one part: they overlap, or come within {NEAR:g} cells."
        for fused in became.values()
        if len(fused) > 1
    ]
    if inside:
        lies = "lies" if len(inside) == 1 else "lie"
        said.append(f"{_named(surface, points, parts, inside)} {lies} inside of others and left no quads.")
    return said


def _named(surface: PolygonMesh, points: NDArray[np.float64], parts: NDArray[np.int64], which: Sequence[int]) -> str:
    """Name parts, the largest first."""
    sizes = [float(np.linalg.norm(np.ptp(points[parts == part], axis=0))) for part in which]
    order = [which[number] for number in np.argsort(sizes, kind="stable")[::-1]]
    names = [_name(surface, points[parts == part]) for part in order[:NAMED]]
    if len(order) > NAMED:
        names.append(f"{len(order) - NAMED:,} smaller ones")
    text = " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
    return text[0].upper() + text[1:] if text.startswith("a part") else text


def _name(surface: PolygonMesh, own: NDArray[np.float64]) -> str:
    """Name a part by its group, or else by its size and middle."""
    low, high = own.min(axis=0), own.max(axis=0)
    for name, vertices in surface.groups.items():
        group = surface.points[vertices]
        if np.array_equal(group.min(axis=0), low) and np.array_equal(group.max(axis=0), high):
            return name
    return f"a part of {np.ptp(own, axis=0).max():.3g} at {place_said((low + high) / 2.0)}"

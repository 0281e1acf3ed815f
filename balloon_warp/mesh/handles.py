"""The handles of a surface, or holes through it: how many it has, and how many cells keep them."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import triangulate
from balloon_warp.mesh.mesh_distance import MeshDistance
from balloon_warp.mesh.orientation import facing_outward
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.seams import welded_along_seams
from balloon_warp.mesh.surface_nets import extract, grid_nodes
from balloon_warp.mesh.topology import component_count, genus, inconsistent_edges, mesh_edges

AHEAD = 0.01
"""Free distance in front of a clean surface, over a triangle's size, and at least `LEAST_AHEAD` cells"""
LEAST_AHEAD = 1e-3
CROSSING = 1e-3
"""Least fraction of the surface inside the rest of it where parts cross"""
COARSEST = 8
"""Node spacing of the grid that is searched first [cells]"""


def handles_lost(surface: PolygonMesh, result: PolygonMesh) -> int | None:
    """Return how many handles fewer a closed mesh has than its source surface, negative if it has more.

    None where the number is meaningless: a surface that is open or crosses itself has none, and parts that merged or
    vanished took theirs along.
    """
    parts, handles = _counted(result)
    parts_before, handles_before = _counted(facing_outward(welded_along_seams(surface)))
    if handles is None or handles_before is None or parts != parts_before:
        return None
    lost = handles_before - handles
    return lost if not lost or not _crosses_itself(surface) else None


def handle_count(surface: PolygonMesh) -> int:
    """Return the handles of a closed surface."""
    return _counted(facing_outward(welded_along_seams(surface)))[1] or 0


def handles_said(lost: int, handles: int) -> str:
    """Return the change of the number of handles, as the end of a sentence."""
    if lost > 0:
        return f"{lost:,} of its {handles:,} handles, or holes through it, {'is' if lost == 1 else 'are'} lost"
    return f"it gains {-lost:,} {'handle' if lost == -1 else 'handles'} over its {handles:,}"


def handles_of_level(distance: MeshDistance, reach: NDArray[np.float64]) -> int | None:
    """Return the handles of the zero level of a distance, as surface nets have it with cells of 1.

    Args:
        distance: of a closed surface: nowhere does it change by more than the way.
        reach: half of the box around the middle that the surface is in, shape (3,).
    """
    blocks = np.ceil(2.0 * reach / COARSEST).astype(int) + 1
    lower = -0.5 * COARSEST * blocks - 0.5  # the nodes of `surface_nets`, whose middle is that of a cell
    values, step = distance(grid_nodes(lower, float(COARSEST), blocks)).reshape(blocks + 1), COARSEST
    while step > 1:
        step //= 2
        values = _finer(values, distance, lower, step)
    return _counted(extract(values, lower, 1.0))[1]


def _finer(
    values: NDArray[np.float64], distance: Callable, lower: NDArray[np.float64], step: int
) -> NDArray[np.float64]:
    """Return the distance at nodes that are half as far from each other; far from the surface the least that it can be.

    Args:
        values: at the nodes before, shape (nx, ny, nz).
        step: between the new ones.
    """
    cells = 2 * (np.array(values.shape) - 1)
    for axis in range(3):
        values = np.take(values, np.arange(cells[axis] + 1) // 2, axis=axis)
    way = np.sqrt(3.0) * step
    near = np.abs(values) <= 1.01 * way
    values = values - np.sign(values) * way
    values[near] = distance(lower + step * np.argwhere(near))
    return values


def _counted(mesh: PolygonMesh) -> tuple[int, int | None]:
    """Return the numbers of parts and of handles.

    The latter is None where the mesh is open, crossed or mixed in winding.
    """
    edges = mesh_edges(mesh)
    handles = None if len(inconsistent_edges(edges)) else genus(mesh, edges)
    return component_count(mesh, edges), handles


def _crosses_itself(surface: PolygonMesh) -> bool:
    """Return whether parts of a closed surface are within other parts of it."""
    used = surface.points[surface.face_vertex_indices]
    size = np.ptp(used, axis=0).max()
    points = (surface.points - used.mean(axis=0)) * (256.0 / size)  # Warp measures in float32
    triangles, _ = triangulate(facing_outward(welded_along_seams(surface)))
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    normals = np.cross(b - a, c - a)
    doubled = np.linalg.norm(normals, axis=1)
    some = doubled > 0.0
    ahead = np.maximum(AHEAD * np.sqrt(doubled[some]), LEAST_AHEAD) / doubled[some]
    before = (a + b + c)[some] / 3.0 + ahead[:, None] * normals[some]
    within = MeshDistance(points, triangles, thickness=0.0)(before) < 0.0
    return bool(doubled[some][within].sum() > CROSSING * doubled.sum())

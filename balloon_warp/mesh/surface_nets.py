"""Signed distance to a closed mesh of even quads: surface nets, then relaxation on the surface."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray
from warp.geometry import IsoSurfaceNets

from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.relaxation import Distance, relax
from balloon_warp.mesh.uncrossed import without_crossings


def surface_nets(distance: Distance, lower: ArrayLike, upper: ArrayLike, cell: float) -> PolygonMesh:
    """Mesh the zero level of a signed distance as a closed mesh of even quads, wound outward.

    It does not cross itself. The distance may be off in scale, as that of a smooth union is, but must be continuous
    near its zero level. The level is cut off at the box; parts thinner than a cell may be lost.

    Args:
        distance: the signed distance.
        lower: corner of the box to search, shape (3,).
        upper: the opposite corner, shape (3,). The grid is centered in the box and covers it.
        cell: width of a grid cell, about the length of an edge.
    """
    lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    # An odd number of cells: a plane of symmetry through the middle of the box then goes through vertices.
    cells = 2 * np.ceil((upper - lower) / (2.0 * cell)).astype(int) + 1
    lower = 0.5 * (lower + upper) - 0.5 * cell * cells
    values = distance(grid_nodes(lower, cell, cells)).reshape(cells + 1)
    # A solid larger than the box is cut off there: the level ends within the grid.
    for axis in range(3):
        ends = np.moveaxis(values, axis, 0)
        ends[[0, -1]] = np.maximum(ends[[0, -1]], 0.5 * cell)
    mesh = extract(values, lower, cell)
    return without_crossings(mesh, relax(mesh, distance, cell))


def grid_nodes(lower: NDArray[np.float64], cell: float, cells: NDArray[np.int_]) -> NDArray[np.float64]:
    """Return the nodes of a grid of `cells` cells along each axis, x slowest, shape (node_count, 3)."""
    index = np.stack(np.meshgrid(*(np.arange(n + 1) for n in cells), indexing="ij"), axis=-1)
    return lower + cell * index.reshape(-1, 3)


def extract(values: NDArray[np.float64], lower: NDArray[np.float64], cell: float) -> PolygonMesh:
    """Return the surface nets of a sampled signed distance: a quad for each grid edge that the zero level crosses.

    Where the level passes through a cell more than once, each pass has a vertex of its own (Warp sees to that), so
    each edge lies on exactly two faces, for any samples. Runs on Warp's default device.

    Args:
        values: the distance at the nodes of a grid, positive all around its border, shape (nx, ny, nz).
        lower: place of the first node, shape (3,).
        cell: width of a grid cell.
    """
    field: Any = wp.array3d(values, dtype=wp.float32)
    vertices, indices = IsoSurfaceNets.extract(field, 0.0, topology="quad")
    corners = indices.numpy().astype(np.int32)
    return PolygonMesh(
        # Warp gives points in grid units: placed here in float64.
        points=lower + cell * vertices.numpy().astype(np.float64),
        face_vertex_counts=np.full(len(corners) // 4, 4, dtype=np.int32),
        face_vertex_indices=corners,
    )

"""Limits of float32: size of a balloon, and distance from the origin."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.polygon_mesh import PolygonMesh

LEAST_SIZE, LARGEST_SIZE = 1.0e-6, 1.0e9
"""Range of the size of a balloon [m]"""
LEAST_SIZE_OVER_DISTANCE = 1.0e-4
"""Least size of a balloon over its distance from the origin: float32 then resolves a thousandth of it"""


def require_size(mesh: PolygonMesh, source: object) -> None:
    """Refuse meshes that float32 cannot simulate: extreme sizes, and positions far from the origin for their size.

    Args:
        mesh: in the world [m].

    Raises:
        InputError: names `source`, the size, and the expected one.
    """
    size = float(np.ptp(mesh.points[mesh.face_vertex_indices], axis=0).max())
    if not LEAST_SIZE <= size <= LARGEST_SIZE:
        expected = f"expected {LEAST_SIZE:g} to {LARGEST_SIZE:g} m; balloon.scale changes it"
        raise InputError(f"{source}: is {size:g} m across; {expected}")
    require_reach(mesh, source, box_corners(mesh))


def box_corners(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return the corners of the box around the mesh's faces, along the axes, shape (8, 3)."""
    points = mesh.points[mesh.face_vertex_indices]
    ends = np.stack([points.min(axis=0), points.max(axis=0)])
    return np.array([[ends[x, 0], ends[y, 1], ends[z, 2]] for x in (0, 1) for y in (0, 1) for z in (0, 1)])


def require_reach(mesh: PolygonMesh, source: object, corners: NDArray[np.float64]) -> None:
    """Make sure that float32 resolves the balloon wherever a world puts it.

    Args:
        corners: of the box around it, there [m], shape (..., 3).

    Raises:
        InputError: it does not.
    """
    size = float(np.ptp(mesh.points[mesh.face_vertex_indices], axis=0).max())
    reach = float(np.abs(corners).max())
    if size < LEAST_SIZE_OVER_DISTANCE * reach:
        raise InputError(
            f"{source}: is {size:g} m across and {reach:g} m from the origin, too far for 32-bit floats; "
            "balloon.position moves it closer"
        )

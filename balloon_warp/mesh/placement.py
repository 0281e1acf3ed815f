"""Axes, unit and place of a mesh."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.polygon_mesh import PolygonMesh


def place_mesh(
    mesh: PolygonMesh,
    up_axis: str,
    scale: float = 1.0,
    rotation: Sequence[float] = (0.0, 0.0, 0.0),
    position: Sequence[float] = (0.0, 0.0, 0.0),
) -> PolygonMesh:
    """Return the mesh in meters, turned to the up axis ("Y" or "Z"), then scaled, rotated and moved.

    Args:
        rotation: about x, then y, then z [degrees].
        position: where the mesh's origin goes [m].
    """
    points = mesh.points * (mesh.meters_per_unit * scale)
    if mesh.up_axis != up_axis:
        points = points @ axes_matrix(mesh.up_axis, up_axis).T
    for axis, degrees in enumerate(rotation):
        points = points @ _rotation(axis, degrees).T
    return replace(mesh, points=points + np.array(position), up_axis=up_axis, meters_per_unit=1.0)


def axes_matrix(mesh_up: str, up_axis: str) -> NDArray[np.float64]:
    """Return the matrix that turns one up axis, "Y" or "Z", to another."""
    if mesh_up == up_axis:
        return np.eye(3)
    return _rotation(0, 90.0 if up_axis == "Z" else -90.0)


def rotation_matrix(rotation: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix of a rotation about x, then y, then z [degrees], which takes a column to where it is then."""
    about_x, about_y, about_z = (_rotation(axis, float(degrees)) for axis, degrees in enumerate(rotation))
    return about_z @ about_y @ about_x


def in_y_up_meters(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh in meters, y up, which is how an OBJ file is taken. To the last bit: axes change places."""
    points = mesh.points * mesh.meters_per_unit
    if mesh.up_axis == "Z":
        points = points[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
    return replace(mesh, points=points, up_axis="Y", meters_per_unit=1.0)


def _rotation(axis: int, degrees: float) -> NDArray[np.float64]:
    """Return the matrix of a right-handed rotation about a coordinate axis."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.eye(3)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix[first, first] = matrix[second, second] = cosine
    matrix[first, second], matrix[second, first] = -sine, sine
    return matrix

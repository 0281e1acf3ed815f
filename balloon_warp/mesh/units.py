"""Units of length and up axes that a mesh may have."""

from dataclasses import replace
from typing import Literal

from balloon_warp.mesh.polygon_mesh import PolygonMesh

UpAxis = Literal["Y", "Z"]
Unit = Literal["m", "cm", "mm", "km", "in", "ft"]
METERS: dict[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "km": 1000.0, "in": 0.0254, "ft": 0.3048}
"""Meters in each unit; inch and foot are the international ones of 1959"""
NO_AXIS = "file names no up axis"
"""Phrase for a mesh without an up axis"""


def as_told(mesh: PolygonMesh, unit: Unit | None, up: UpAxis | None) -> PolygonMesh:
    """Return the mesh with its unit and up axis as given, in place of its file's; those of the file, when missing."""
    if unit:
        mesh = replace(mesh, meters_per_unit=METERS[unit], unit_known=True)
    return replace(mesh, up_axis=up, up_known=True) if up else mesh

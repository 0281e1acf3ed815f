"""Up axis of a shape: that of its file, or a guess, by its widest flat side."""

from typing import Literal

import numpy as np

from balloon_warp.mesh.geometry import face_areas, face_vector_areas
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.units import NO_AXIS

BY_CUSTOM: dict[str, Literal["Y", "Z"]] = {".stl": "Z", ".ply": "Y", ".off": "Y"}
"""Up axes of files without one: models for printing are drawn upright along Z"""
FLAT = 0.99
"""Least cosine between a flat side's faces and its axis"""
AT_THE_END = 0.01
"""Largest distance of a flat side from the end of the shape, over its size"""
SLAB = 0.15
"""Largest height of a slab over its width"""
LEAST, CLEARLY = 0.02, 3.0
"""Least area of a flat side over that of the surface; and over that which the custom has below, to count for more"""


def standing(mesh: PolygonMesh, suffix: str) -> tuple[Literal["Y", "Z"], str] | None:
    """Return the axis that is probably up, and why, in words; None where there is nothing to guess.

    Args:
        suffix: of the mesh's file.
    """
    if mesh.up_known or suffix.lower() not in BY_CUSTOM or not mesh.face_count:
        return None
    custom = BY_CUSTOM[suffix.lower()]
    other: Literal["Y", "Z"] = "Y" if custom == "Z" else "Z"
    below = {axis: _wider_below(mesh, "XYZ".index(axis)) for axis in (custom, other)}
    if below[other] > max(CLEARLY * below[custom], LEAST):
        return other, "which has its widest flat side below"
    if below[custom] > LEAST:
        return custom, "which has its widest flat side below"
    return (custom, f"as by custom in {suffix.lower()[1:].upper()} files") if custom != mesh.up_axis else None


def up_said(mesh: PolygonMesh, given: bool, why: str | None) -> str:
    """Return a sentence on the up axis of a mesh, and its source.

    Args:
        given: whether a user has said it.
        why: it was guessed, where it was.
    """
    if mesh.up_known and not why:
        return f"{mesh.up_axis} is up, as {'given' if given else 'its file says'}"
    reason = f", {why}" if why else ""
    return f"The {NO_AXIS}, so {mesh.up_axis} is up{reason}; --up {'Y' if mesh.up_axis == 'Z' else 'Z'} turns it"


def _wider_below(mesh: PolygonMesh, axis: int) -> float:
    """Return how much more of the surface is flat at the lower end of an axis than at the upper one, from -1 to 1.

    A slab lies, though both of its sides are flat.
    """
    vectors, areas = face_vector_areas(mesh)[:, axis], face_areas(mesh)
    used = mesh.points[mesh.face_vertex_indices]
    near = AT_THE_END * float(np.ptp(used, axis=0).max())
    heights = np.maximum.reduceat(used[:, axis], np.cumsum(mesh.face_vertex_counts) - mesh.face_vertex_counts)
    lows = np.minimum.reduceat(used[:, axis], np.cumsum(mesh.face_vertex_counts) - mesh.face_vertex_counts)
    flat = np.abs(vectors) > FLAT * areas
    lower = areas[flat & (heights < used[:, axis].min() + near)].sum()
    upper = areas[flat & (lows > used[:, axis].max() - near)].sum()
    if np.ptp(used[:, axis]) < SLAB * np.sort(np.ptp(used, axis=0))[1]:
        upper = 0.0
    return float((lower - upper) / max(areas.sum(), 1e-300))

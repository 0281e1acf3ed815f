"""The scene that a bare mesh gets: it inflates gently above a floor, everything scaled to the mesh's size."""

from pathlib import Path
from typing import Any

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.placement import place_mesh
from balloon_warp.mesh.prepare import prepared
from balloon_warp.mesh.size import require_size
from balloon_warp.scene.pins import pinned_at_borders
from balloon_warp.scene.schema import Balloon, Inflation

WEIGHT = 1.81
"""of a balloon with its lift [N/kg], for each meter of its size"""
MOLAR_VOLUME = 0.02406
"""of a gas in the atmosphere that a scene has if it says nothing of it [m^3/mol]"""
MOST_FLOW = 9e11
"""that a pump may have [mol/s]: what is kilometers large gets less"""


def scene_table_around(source: Path | PolygonMesh, balloon: Balloon, up_axis: str | None) -> dict[str, Any]:
    """A scene's table for a mesh, or the mesh of a file.

    Accelerations and k_normal grow with the mesh's size, so that a mesh in centimeters moves as one in meters does:
    with masses and spring constants alike, forces, lengths and accelerations all scale together.

    A closed mesh falls a little, onto the floor. An open one is held at its borders: its inflation, which nothing
    balances there, would drive it away.

    Args:
        balloon: how the mesh is to be placed, and what kind of inflation it is to have.
        up_axis: "Y" or "Z"; the mesh's own when missing.

    Raises:
        InputError: the mesh cannot be read, has no face or no size, or its size or place is too much for float32.
    """
    label = source.name if isinstance(source, PolygonMesh) else source
    mesh = prepared(load_mesh(source), label, balloon.treatment)
    up_axis = up_axis or mesh.up_axis
    placed = place_mesh(mesh, up_axis, balloon.scale, balloon.rotation, balloon.position)
    points = placed.points[placed.face_vertex_indices]
    lowest, highest = points.min(axis=0), points.max(axis=0)
    size = float((highest - lowest).max())
    if size == 0.0:
        raise InputError(f"{label}: all its vertices stand at one place; expected a mesh with some size")
    require_size(placed, label)
    gas = balloon.inflation.kind == "gas"
    return {
        "description": f"{source.name} inflates above a floor",
        "up_axis": up_axis,
        "gravity": (WEIGHT if gas else 9.81) * size,
        "frames": 120,
        "balloon": [
            {
                "mesh": source if isinstance(source, PolygonMesh) else source.resolve(),
                "mass": 2.0,
                "helium": 0.0 if gas else (9.81 - WEIGHT) * size,
                "damping": 20.0,
                "stiffness": {"structural": 100.0, "shear": 50.0, "flexion": 20.0, "thin": "softer"},
                "inflation": _gentle(balloon.inflation, placed, size),
                "fixed": pinned_at_borders(mesh, balloon.parts).tolist(),
            }
        ],
        "ground": {"height": float(lowest["XYZ".index(up_axis)]) - 0.05 * size},
    }


def _gentle(inflation: Inflation, placed: PolygonMesh, size: float) -> dict[str, Any]:
    """Inflation up to 1.5 s at most: the pressure that a balloon gets by itself; or half as much gas again as fits into
    the mesh, unless it is said how much; or normal forces in proportion to the size."""
    if inflation.kind == "pressure":
        return {}
    if inflation.kind == "normal_force":
        return {"k_normal": [[0.2, 0.0], [1.5, 4.0 * size]]}
    if inflation.amount is not None or inflation.start_pressure:
        return {}
    flow = min(0.5 * abs(signed_volume(placed)) / MOLAR_VOLUME / 1.2, MOST_FLOW)
    return {"pump": [[0.2, 0.0], [0.3, flow], [1.4, flow], [1.5, 0.0]]}

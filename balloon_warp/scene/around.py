"""The scene that a bare mesh gets: it inflates gently above a floor, everything scaled to the mesh's size."""

from pathlib import Path
from typing import Any

from balloon_warp.mesh.load import load_mesh


def scene_table_around(path: Path) -> dict[str, Any]:
    """A scene's table for the mesh in `path`.

    Gravity grows with the mesh's size, so that a mesh in centimeters moves as one in meters does: with masses and
    spring constants alike, forces, lengths and accelerations all scale together.

    Raises:
        InputError: the mesh cannot be read.
    """
    mesh = load_mesh(path)
    points = mesh.points[mesh.face_vertex_indices] * mesh.meters_per_unit
    lowest, highest = points.min(axis=0), points.max(axis=0)
    size = float((highest - lowest).max())
    up = "XYZ".index(mesh.up_axis)
    return {
        "description": f"{path.name} inflates above a floor",
        "up_axis": mesh.up_axis,
        "gravity": 9.81 * size,
        "frames": 120,
        "balloon": [
            {
                "mesh": path.resolve(),
                "damping": 0.3,
                "inflation": {"k_normal": [[0.0, 0.0], [1.0, 0.25 * size]]},
            }
        ],
        "ground": {"height": float(lowest[up]) - 0.1 * size},
    }

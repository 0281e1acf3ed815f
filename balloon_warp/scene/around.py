"""The scene that a bare mesh gets: it inflates gently above a floor, everything scaled to the mesh's size."""

from pathlib import Path
from typing import Any

import numpy as np

from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.topology import border_edges, mesh_edges


def scene_table_around(path: Path) -> dict[str, Any]:
    """A scene's table for the mesh in `path`.

    Accelerations and k_normal grow with the mesh's size, so that a mesh in centimeters moves as one in meters does:
    with masses and spring constants alike, forces, lengths and accelerations all scale together.

    A closed mesh falls a little, onto the floor. An open one is held at its border: its inflation, which nothing
    balances there, would drive it away.

    Raises:
        InputError: the mesh cannot be read.
    """
    mesh = load_mesh(path)
    points = mesh.points[mesh.face_vertex_indices] * mesh.meters_per_unit
    lowest, highest = points.min(axis=0), points.max(axis=0)
    size = float((highest - lowest).max())
    edges = mesh_edges(mesh)
    border = np.unique(edges.ends[border_edges(edges)])
    everything = len(border) == len(np.unique(mesh.face_vertex_indices))
    return {
        "description": f"{path.name} inflates above a floor",
        "up_axis": mesh.up_axis,
        "gravity": 9.81 * size,
        "frames": 120,
        "normals": "fresh",
        "balloon": [
            {
                "mesh": path.resolve(),
                "mass": 2.0,
                "helium": 8.0 * size,
                "damping": 20.0,
                "stiffness": {"structural": 100.0, "shear": 50.0, "flexion": 20.0},
                "inflation": {"k_normal": [[0.2, 0.0], [1.5, 4.0 * size]]},
                "fixed": [] if everything else border.tolist(),
            }
        ],
        "ground": {"height": float(lowest["XYZ".index(mesh.up_axis)]) - 0.05 * size},
    }

"""The command `inspect`, and meshes with something wrong."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from meshes import mesh_of

from balloon_warp.mesh import PolygonMesh


def with_faces(mesh: PolygonMesh, *faces: list[int]) -> PolygonMesh:
    """Return the mesh with more faces."""
    added = mesh_of([], faces)
    return replace(
        mesh,
        face_vertex_counts=np.concatenate([mesh.face_vertex_counts, added.face_vertex_counts]),
        face_vertex_indices=np.concatenate([mesh.face_vertex_indices, added.face_vertex_indices]),
    )


def inside_out(mesh: PolygonMesh) -> PolygonMesh:
    return replace(mesh, face_vertex_indices=mesh.face_vertex_indices[::-1].copy())


def command(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "balloon_warp", "inspect", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, "COLUMNS": "100"},
    )

"""The command line in this process, `inspect` of meshes with something wrong, and the work of a call."""

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
from meshes import mesh_of

from balloon_warp import cli
from balloon_warp.mesh import PolygonMesh


def status_of(*words: str, main: Callable[[], object] = cli.main) -> int:
    """Run a command, as a user types it, and return its exit status."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["balloon-warp", *words])
        with pytest.raises(SystemExit) as ended:
            main()
    return int(ended.value.code or 0)


def lines_executed(call: Callable[[], Any]) -> int:
    """Return the lines of Python that a call executes, in all functions; NumPy's work counts as its line."""
    count = 0

    def trace(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal count
        count += event == "line"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    finally:
        sys.settrace(before)
    return count


def contents(folder: Path) -> dict[str, bytes]:
    """Return the files in a folder and those below it, by their paths from there."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


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

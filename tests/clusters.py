"""Helpers of the tests of clusters."""

import sys
from pathlib import Path
from typing import Any

import pytest
from meshes import quad_sphere

from balloon_warp.cli import main
from balloon_warp.mesh.obj import write_obj


def address_of(workers: Any) -> str:
    """Return the address of the workers' scheduler, which Dask's types take for an awaitable."""
    return workers.scheduler_address


def batch(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    """Run the command in this process and return its exit status."""
    monkeypatch.setattr(sys, "argv", ["balloon-warp", "batch", "ball.obj", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def write_ball(folder: Path) -> Path:
    write_obj(folder / "ball.obj", quad_sphere(2))
    return folder / "ball.obj"

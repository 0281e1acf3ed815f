"""Helpers of the tests of clusters."""

import sys
from pathlib import Path
from typing import Any

import pytest
from meshes import quad_sphere

from balloon_warp.cli import main
from balloon_warp.mesh.obj import write_obj


def address_of(workers: Any) -> str:
    """Address of the scheduler of workers, which Dask's types take for something to wait for."""
    return workers.scheduler_address


def batch(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    """Exit status of the command."""
    monkeypatch.setattr(sys, "argv", ["balloon-warp", "batch", "ball.obj", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def write_ball(folder: Path) -> Path:
    write_obj(folder / "ball.obj", quad_sphere(2))
    return folder / "ball.obj"

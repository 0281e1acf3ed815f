"""Kernels that are compiled ahead are all that a run or a batch needs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from meshes import quad_sphere

from balloon_warp.mesh.obj import write_obj

COMMAND = """
import warp as wp
from balloon_warp.__main__ import main
wp.config.optimization_level = 0
main()
"""
"""balloon-warp, with kernels that stay as they are written: it is about which are compiled"""


@pytest.mark.parametrize(
    ("options", "later"),
    [
        pytest.param("", "run ball.obj --frames 3 --picture", id="run", marks=pytest.mark.nightly),
        pytest.param(
            "--worlds 9", "batch ball.obj --frames 3 --worlds 12 --vary balloon.mass=1:3 --export all", id="batch"
        ),
    ],
)
def test_a_command_compiles_nothing_after_it(options: str, later: str, tmp_path: Path):
    write_obj(tmp_path / "ball.obj", quad_sphere(3))
    assert balloon_warp(tmp_path, "warm-up", "ball.obj", *options.split()).startswith("ball: ")
    compiled = kernels(tmp_path)
    assert compiled
    balloon_warp(tmp_path, *later.split())
    assert kernels(tmp_path) == compiled


def balloon_warp(folder: Path, *arguments: str) -> str:
    words = [sys.executable, "-c", COMMAND, *arguments, "--device", "cpu"]
    environment = {**os.environ, "WARP_CACHE_PATH": str(folder / "kernels")}
    done = subprocess.run(words, env=environment, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def kernels(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in (folder / "kernels").rglob("*.o")}

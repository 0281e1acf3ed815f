"""Options of a run's length: --fps, --frames and --seconds."""

from pathlib import Path

import pytest
from meshes import quad_sphere

from balloon_warp.cli.changes import Changes
from balloon_warp.cli.options import LengthOptions
from balloon_warp.mesh.obj import write_obj


@pytest.fixture
def ball(tmp_path: Path) -> str:
    """Write a mesh, whose default scene has 120 frames at 60 a second."""
    write_obj(tmp_path / "ball.obj", quad_sphere(2))
    return str(tmp_path / "ball.obj")


@pytest.mark.parametrize(
    ("options", "rate", "frames"),
    [
        ({}, 60.0, 120),
        ({"fps": 24.0}, 24.0, 120),
        ({"frames": 90}, 60.0, 90),
        ({"seconds": 5.0}, 60.0, 300),
        ({"fps": 24.0, "seconds": 5.0}, 24.0, 120),
        ({"fps": 23.976, "seconds": 10.0}, 23.976, 240),  # the nearest
        ({"seconds": 0.001}, 60.0, 1),
    ],
)
def test_they_give_rate_and_frames(ball: str, options: dict, rate: float, frames: int):
    scene = Changes(length=LengthOptions(**options)).load(ball)
    assert (scene.frames_per_second, scene.frames) == (rate, frames)


def test_they_count_for_more_than_what_is_set(ball: str):
    scene = Changes(["frames=7", "frames_per_second=30"], length=LengthOptions(fps=25.0, frames=8)).load(ball)
    assert (scene.frames_per_second, scene.frames) == (25.0, 8)

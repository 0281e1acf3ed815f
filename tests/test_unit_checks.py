"""Plausibility checks of units: implausible numbers raise a question, ordinary ones do not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import cube, quad_sphere

from balloon_warp.cli.app import app
from balloon_warp.mesh.obj import write_obj
from balloon_warp.model import plan_model
from balloon_warp.scene import load_scene
from balloon_warp.scene.load import bundled_scenes


def asked(size: float, **said: object) -> list[str]:
    """Return the questions about a ball of that size."""
    ball = quad_sphere(4, 0.5)
    overrides = {f"balloon.{name.replace('__', '.')}": value for name, value in said.items()}
    scene = load_scene(replace(ball, points=size / np.ptp(ball.points[:, 0]) * ball.points), overrides)
    return [warning for warning in plan_model(scene).warnings if "?" in warning]


@pytest.mark.parametrize("size", [0.03, 0.2, 1.0, 20.0])
@pytest.mark.parametrize("said", [{}, {"material__preset": "latex"}, {"inflation__kind": "gas"}])
def test_nothing_is_asked_about_ordinary_ones(size: float, said: dict) -> None:
    assert asked(size, **said) == []


@pytest.mark.full
@pytest.mark.parametrize("name", bundled_scenes())
def test_nothing_is_asked_about_bundled_scenes(name: str) -> None:
    assert not [warning for warning in plan_model(load_scene(name)).warnings if "?" in warning]


def test_a_size_a_wall_and_a_mass_are_asked_about() -> None:
    assert "100 m? --unit cm?" in asked(100.0)[0]
    assert "2e+03 m? --unit cm?" in asked(2000.0)[0]
    assert "0.0002 m? balloon.scale = 1" in asked(0.0002)[0]
    assert asked(100.0, unit="m") == []
    assert "0.0002 m? --unit mm?" in asked(0.2, unit="mm")[0]
    wall = asked(0.3, material__kind="neo_hookean", material__thickness=0.2)
    assert "a wall 0.2 m thick, for a balloon of 0.3 m?" in wall[0]
    assert "a mass of 500 kg, for a balloon of 1 m?" in asked(1.0, mass=500.0)[0]
    assert plan_model(load_scene(cube())).warnings == []


def test_inspect_asks_too(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """The report of a mesh asks, with the axis and the unit that are assumed, and so does that of a scene."""
    ball = quad_sphere(4, 0.5)
    write_obj(tmp_path / "ball.obj", replace(ball, points=500.0 * ball.points))
    (tmp_path / "big.toml").write_text('up_axis = "Z"\n[[balloon]]\nmesh = "ball.obj"\nmass = 2.0\n')
    for source in ("ball.obj", "big.toml"):
        app(["inspect", str(tmp_path / source)], standalone_mode=False)
        said = capsys.readouterr().out
        assert "m? --unit cm?" in said
        assert "names no up axis" in " ".join(said.split())


@pytest.mark.parametrize("command", ["run", "batch --worlds 2", "inspect"])
@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize("source", ["ball.obj", "ball.toml"])
def test_the_axis_is_said_once(
    source: str, up_axis: str, command: str, tmp_path: Path, capfd: pytest.CaptureFixture
) -> None:
    """The up axis is named once: in the line about a mesh's default scene, or where a scene's mesh is turned."""
    write_obj(tmp_path / "ball.obj", quad_sphere(3, 0.5))
    (tmp_path / "ball.toml").write_text('[[balloon]]\nmesh = "ball.obj"\n')
    name, *options = command.split()
    if name != "inspect":
        options += ["--set", "frames=1", "--device", "cpu", "-o", str(tmp_path / ("out" + ".usdc" * (name == "run")))]
    app([name, str(tmp_path / source), "--set", f"up_axis={up_axis}", *options], standalone_mode=False)
    said = " ".join("".join(capfd.readouterr()).split())
    assert said.count("file names no up axis") == (source == "ball.obj" or up_axis == "Z")

"""Provenance in a stage, independent of its environment."""

import hashlib
import json
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from meshes import quad_sphere
from pxr import Sdf, Usd

from balloon_warp.cli import main
from balloon_warp.mesh.obj import write_obj
from balloon_warp.scene import Scene

SCENE = """
frames = 2
[[balloon]]
mesh = "ball.obj"
"""
COMMAND = ["balloon-warp", "run", "ball.toml", "--set", "balloon.mass=0.5", "--set", "balloon.name='a b'"]
COMMAND += ["--device", "cpu"]


def stage(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, *more: str) -> Any:
    """Return the command's JSON, from a folder with its files in it."""
    folder.mkdir(exist_ok=True)
    (folder / "ball.toml").write_text(SCENE)
    write_obj(folder / "ball.obj", quad_sphere(2))
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", [*COMMAND, "--json", *more])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    return json.loads(capsys.readouterr().out)


def test_a_stage_says_what_it_takes_to_make_it_again(tmp_path, monkeypatch, capsys):
    summary = stage(tmp_path, monkeypatch, capsys, "-o", "ball.usda")
    opened = Usd.Stage.Open(summary["output"])
    said = opened.GetRootLayer().customLayerData["balloonWarp"]
    assert said["command"] == (
        """balloon-warp run ball.toml --set balloon.mass=0.5 --set 'balloon.name='"'"'a b'"'"'' --device cpu"""
    )
    assert said["versions"]["warp-lang"] == metadata.version("warp-lang")
    assert said["meshes"] == {"balloon.0.mesh": hashlib.sha256((tmp_path / "ball.obj").read_bytes()).hexdigest()}
    assert [said[name] for name in ("device", "schedule", "substeps")] == [
        *("cpu", summary["schedule"], summary["substeps"])
    ]
    scene = Scene.model_validate_json(said["scene"])
    assert (scene.frames, scene.balloon[0].mesh, scene.balloon[0].mass) == (2, Path("ball.obj"), 0.5)


def test_where_the_files_are_is_not_in_the_bytes(tmp_path, monkeypatch, capsys):
    first = stage(tmp_path / "here", monkeypatch, capsys, "-o", "one.usdc")
    bytes_here = (tmp_path / "here" / first["output"]).read_bytes()
    stage(tmp_path / "there", monkeypatch, capsys, "--output", "../two.usdc", "--checkpoint", "9", "--resume")
    assert (tmp_path / "two.usdc").read_bytes() == bytes_here
    stage(tmp_path / "there", monkeypatch, capsys, "-o", "../three.usdc", "--set", "frames=3")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "three.usdc"))
    assert layer.customLayerData["balloonWarp"]["command"].endswith("--set frames=3 --device cpu")

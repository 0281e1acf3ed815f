"""Mistakes of a newcomer on the command line: one sentence, and status 2. Nothing is simulated."""

import sys
from pathlib import Path

import pytest
from meshes import quad_sphere

from balloon_warp.cli import main
from balloon_warp.mesh.obj import write_obj


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    write_obj(tmp_path / "ball.obj", quad_sphere(2))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def typed(monkeypatch: pytest.MonkeyPatch, words: str) -> int:
    """Return the exit status of a command line."""
    monkeypatch.setattr(sys, "argv", ["balloon-warp", *words.split()])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("rnu ball.obj", "rnu: no such command; did you mean run?"),
        ("ball.obj", "ball.obj: no such command; did you mean balloon-warp run ball.obj?"),
        ("net_forces --picture", "net_forces: no such command; did you mean balloon-warp run net_forces?"),
        ("xyz run ball.obj", "xyz: no such command; commands are run, view, batch, compare, "),
        ("--vers", "--vers: unknown option of balloon-warp; did you mean --version?"),
        ("run", "run: SCENE is missing; balloon-warp run --help explains"),
        ("run squirel_tether", "squirel_tether: no such scene or file; did you mean squirrel_tether?"),
        ("run bal.obj", "bal.obj: no such scene or file; did you mean ball.obj?"),
        ("render bal.usdc", "bal.usdc: no such file; expected a USD stage"),
        ("remesh ball.obj", "remesh: --output is missing; balloon-warp remesh --help explains"),
        ("run ball.obj --frames", "--frames: has no value; expected --frames COUNT; balloon-warp run --help explains"),
        ("run ball.obj --set", "--set: has no value; expected --set PATH=VALUE; balloon-warp run --help explains"),
        ("run ball.obj --picture=3", "--picture: takes no value; balloon-warp run --help explains"),
        ("run ball.obj --zoom 2", "--zoom: needs --picture"),
        ("run ball.obj --picture --shutter 2", "shutter: 2; expected 0 to 1 of a frame"),
        ("run ball.obj --picture --look-at 1,2", "--look-at 1,2: expected X,Y,Z"),
        ("run ball.obj --picture --look-at Ball", "look-at: 'Ball' is not visible in ball.usdc; did you mean"),
        ("run ball.obj --pictur", "--pictur: unknown option of run; did you mean --picture?"),
        ("run ball.obj -frames 3", "-frames: unknown option of run; did you mean --frames?"),
        ("run ball.obj balloon.mass=3", "run: did not expect balloon.mass=3; --set goes before PATH=VALUE; balloon-"),
        ("run ball.obj --frames few", "--frames: must be a valid integer (got few); balloon-warp run --help explains"),
        ("batch ball.obj --seed -1", "--seed: must be greater than or equal to 0 (got -1); balloon-warp batch"),
        ("run ball.obj --frames 0", "--frames 0: must be greater than or equal to 1 (got 0)"),
        ("run ball.obj --fps 0", "--fps 0: must be greater than 0 (got 0.0)"),
        ("run ball.obj --seconds -1", "--seconds -1: expected a time above 0"),
        ("run ball.obj --frames 3 --seconds 1", "--frames, --seconds: expected only one of them"),
        ("run two_balloons --fps 0.5", "--fps 0.5: balloon.0.inflation.pump: keyframes must be at least a frame"),
        ("run ball.obj --set sphere.2.mass=1", "--set sphere.2.mass: cannot be set, the scene has no sphere"),
        ("inspect ball.obj --set baloon.mass=1", "--set baloon.mass: baloon: unknown table; did you mean balloon?"),
        ("batch ball.obj --set gravity=low", "--set gravity: must be a valid number (got 'low')"),
        ("compare ball.obj", "--vary: is missing; expected a value to vary, as in --vary normals="),
        ("compare ball.obj --vary gravity=1:3", "--vary gravity=1:3: takes values, as in --vary gravity=1,3; ranges "),
        ("bench --json x.json", "bench: did not expect x.json; balloon-warp bench --help explains"),
        ("bench -o x.txt", "x.txt: cannot write .txt; expected .json"),
    ],
)
def test_it_gets_one_sentence(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: str, sentence: str
):
    assert typed(monkeypatch, words) == 2
    said = capsys.readouterr()
    assert said.out == ""
    (mistake,) = [line for line in said.err.splitlines() if not line.startswith("note: ")]  # of the scene, before it
    assert mistake.startswith(f"error: {sentence}")
    assert [path.name for path in folder.iterdir()] == ["ball.obj"]


def test_without_a_command_the_help_is_printed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    assert typed(monkeypatch, "") == 0
    assert "balloon-warp run squirrel_tether --picture" in capsys.readouterr().out

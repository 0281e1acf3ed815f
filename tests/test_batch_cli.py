"""`balloon-warp batch` as a user types it."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from meshes import quad_sphere
from pxr import Usd

from balloon_warp.cli import main
from balloon_warp.mesh.obj import write_obj

SCENE = """
frames = 3
[[balloon]]
mesh = "ball.obj"
[balloon.inflation]
k_normal = 0.2
[[sphere]]
position = [0, 4, 0]
radius = 1.2
"""

TABLES = ("table.npz", "table.csv", "worlds.npz", "worlds.csv")


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "ball.toml").write_text(SCENE)
    write_obj(tmp_path / "scenes" / "ball.obj", quad_sphere(2))
    write_obj(tmp_path / "other.obj", quad_sphere(3))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def batch(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    """Run the command in this process and return its exit status."""
    monkeypatch.setattr(sys, "argv", ["balloon-warp", "batch", "scenes/ball.toml", "--device", "cpu", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def test_a_batch_in_which_nothing_varies_says_so(folder: Path, monkeypatch, capsys):
    assert batch(monkeypatch, "--worlds", "2") == 0
    assert "\nnote: all worlds are alike; --vary PATH=LOW:HIGH" in capsys.readouterr().err
    assert batch(monkeypatch, "--worlds", "2", "--vary", "sphere.0.mass=10,10") == 0
    assert "\nnote: all worlds are alike" in capsys.readouterr().err
    assert batch(monkeypatch, "--worlds", "1") == 0
    assert "note: " not in capsys.readouterr().err


def test_the_summary_is_one_object_and_the_files_are_where_it_says(folder: Path, monkeypatch, capsys):
    varied = ["--vary", "balloon.inflation.k_normal=0:8", "--vary", "sphere.0.mass=1,10,100", "--grid"]
    assert batch(monkeypatch, "--worlds", "9", *varied, "--export", "0,5", "-o", "out", "--json") == 0
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    assert line.startswith("ball: 9 worlds, 234 particles, ")
    summary = json.loads(captured.out)
    assert (summary["worlds"], summary["exported_worlds"], summary["unhealthy_worlds"]) == (9, 2, 0)
    assert (summary["scene"], summary["frames"], summary["particles"]) == ("ball", 3, 9 * 26)
    assert summary["table"] == ["out/table.npz", "out/table.csv"]
    with np.load(folder / "out" / "table.npz") as table:
        np.testing.assert_array_equal(table["balloon.inflation.k_normal"][:9], np.arange(9.0))
        np.testing.assert_array_equal(table["sphere.0.mass"][:9], [1, 10, 100] * 3)
        volume = table["volume"].reshape(4, 9)
    assert (np.diff(volume[-1]) > 0.0).all()  # the more a balloon is inflated, the larger it is
    stage = Usd.Stage.Open(summary["stage"])
    names = [prim.GetName() for prim in stage.GetDefaultPrim().GetChildren()]
    assert [name for name in names if name.startswith("World_")] == ["World_0", "World_5"]


def test_meshes_differ_and_the_same_seed_gives_the_same_table(folder: Path, monkeypatch):
    varied = ["--worlds", "4", "--vary", "balloon.mesh=ball.obj,other.obj", "--vary", "gravity=1:9"]
    for seed, out in (("0", "a"), ("0", "b"), ("1", "c")):
        assert batch(monkeypatch, *varied, "--seed", seed, "-o", out) == 0
    first, again, other = ((folder / out / "table.csv").read_text() for out in "abc")
    assert first == again != other
    assert first.splitlines()[2].startswith("1,0,0.0,other.obj,")


@pytest.mark.parametrize(
    ("vary", "complaint"),
    [
        ("balloon.mas=1:2", "balloon.0.mas: unknown field; did you mean mass?"),
        ("balloon.mass=1,-1", "balloon.0.mass: must be greater than 0 (got -1.0), in world 1"),
        ("balloon.scale=1,-1", "balloon.0.scale: must be greater than 0 (got -1.0), in world 1"),
        ("water.level=0:1", "cannot differ between worlds, the scene has no water"),
    ],
)
def test_a_mistake_in_what_differs_names_the_option(folder: Path, monkeypatch, capsys, vary: str, complaint: str):
    assert batch(monkeypatch, "--worlds", "3", "--vary", vary) == 2
    assert capsys.readouterr().err == f"error: --vary {vary.partition('=')[0]}: {complaint}\n"


@pytest.mark.full
def test_what_blew_up_is_told(folder: Path, monkeypatch, capsys):
    assert batch(monkeypatch, "--worlds", "3", "--vary", "balloon.inflation.k_normal=0,9e11,0") == 0
    captured = capsys.readouterr()
    said, warned = captured.out.splitlines(), captured.err.splitlines()[1:]
    assert said[0].startswith("ball: 3 worlds, 78 particles, 3 frames of ")
    assert warned[0].startswith("warning: the simulation blew up in frame 1, world 1, substep 1 of ")
    assert warned[1:] == ["warning: 1 of 3 worlds blew up: health 0; their rows repeat the last good frame"]
    assert said[1:] == [f"wrote ball_batch/{name}" for name in (*TABLES, "manifest.json")]


def test_the_stage_of_an_earlier_batch_does_not_stay_beside_a_later_table(folder: Path, monkeypatch, capsys):
    assert batch(monkeypatch, "--worlds", "2", "--export", "all") == 0
    assert (
        "wrote ball_batch/worlds.usdc: 0.05 s at 60 frames/s; in Blender, set the frame rate to 60, "
        in capsys.readouterr().out
    )
    assert batch(monkeypatch, "--worlds", "2", "--vary", "gravity=2:1") == 2
    assert (folder / "ball_batch" / "worlds.usdc").exists()  # a batch that is refused leaves all as it was
    capsys.readouterr()
    assert batch(monkeypatch, "--worlds", "3") == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("removed ball_batch/worlds.usdc")
    left = sorted(path.name for path in (folder / "ball_batch").iterdir())
    assert left == sorted([*TABLES, "manifest.json"])
    assert batch(monkeypatch, "--worlds", "3") == 0
    assert "removed" not in capsys.readouterr().out


def test_one_is_one_and_names_are_as_they_are(folder: Path, monkeypatch, capsys):
    assert batch(monkeypatch, "--worlds", "1", "--set", "frames=1", "--set", "substeps=10", "-o", "a [bold] one") == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("ball: 1 world, 26 particles, 1 frame of 10 substeps in ")
    assert said[1] == "wrote a [bold] one/table.npz"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--vary", "balloon.mass"], "--vary balloon.mass: expected PATH=LOW:HIGH with LOW below HIGH"),
        (["--vary", "balloon.mass=-2:-1"], "--vary balloon.mass: balloon.0.mass: must be greater than 0"),
        (
            ["--vary", "frames=1,2"],
            "--vary frames: cannot differ between worlds, only between runs of `compare`; what can: ",
        ),
        (["--vary", "substeps=1:9"], "--vary substeps: cannot differ between worlds, only between runs of `compare`; "),
        (["--vary", "normals=cached,fresh"], "--vary normals=cached,fresh: expected PATH=LOW:HIGH with LOW below HIGH"),
        (["--export", "64"], "--export 64: no world 64, the batch has worlds 0 to 63"),
        (["--worlds", "0", "--vary", "gravity=1,2"], "--worlds 0: expected at least 1"),
        (["--worlds", "-2", "--vary", "gravity=1:2", "--grid"], "--worlds -2: expected at least 1"),
    ],
)
def test_a_mistake_gets_one_sentence_and_status_2(folder, monkeypatch, capsys, arguments, sentence):
    assert batch(monkeypatch, *arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"error: {sentence}")
    assert len(captured.err.splitlines()) == 1
    assert not (folder / "ball_batch").exists()

"""Command line as a user meets it: in a process of its own, in an empty folder."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from meshes import cube, quad_sphere
from PIL import Image

from balloon_warp import bundled_scenes, load_scene
from balloon_warp.cli import main
from balloon_warp.mesh.obj import read_obj, write_obj

SUMMARY_KEYS = [
    "output",
    "picture",
    "points",
    "scene",
    "device",
    "schedule",
    "worlds",
    "particles",
    "springs",
    "frames",
    "begin",
    "frames_per_second",
    "substeps",
    "restarts",
    "blow_up",
    "bad_endings",
    "inflation",
    "wall_seconds",
    "particle_substeps_per_second",
]


ONE_FACE = """#usda 1.0
def Mesh "face"
{
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
}
"""


def balloon_warp(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "balloon_warp", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=600,
        env={**os.environ, "NO_COLOR": "1", "COLUMNS": "200"},
    )


@pytest.fixture
def command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run the command line in this process, to test its output and not how a process starts."""
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.chdir(tmp_path)

    def ended(*arguments: str) -> subprocess.CompletedProcess[str]:
        monkeypatch.setattr(sys, "argv", ["balloon-warp", *arguments])
        with pytest.raises(SystemExit) as end:
            main()
        said = capfd.readouterr()
        return subprocess.CompletedProcess(arguments, int(end.value.code or 0), said.out, said.err)

    return ended


FIRST_LINE = "note: ball.obj inflates above a floor. Its unit is not known"

SECOND_LINE = "note: auto pressure 44.6 Pa, volume 1.00 -> 1.33"


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    write_obj(tmp_path / "ball.obj", quad_sphere(3))
    return tmp_path


@pytest.mark.full
def test_run_writes_stage_and_picture_and_says_where(ball: Path):
    done = balloon_warp(ball, "run", "ball.obj", "--picture", "--set", "frames=3", "--device", "cpu")
    assert done.returncode == 0, done.stderr
    first, *others = done.stderr.splitlines()
    assert first.startswith(FIRST_LINE)
    assert others == [SECOND_LINE]  # no bar in a pipe, no word of Warp's
    assert done.stdout.splitlines()[1:] == [
        "wrote ball.usdc: 0.05 s at 60 frames/s; in Blender, set the frame rate to 60, or run with --fps 24",
        "wrote ball.png",
    ]
    assert done.stdout.startswith("ball: 56 particles, 312 springs, 3 frames of ")
    assert sorted(path.name for path in ball.iterdir()) == ["ball.obj", "ball.png", "ball.usdc"]
    assert Image.open(ball / "ball.png").size == (960, 540)


@pytest.mark.full
def test_one_is_one(ball: Path):
    options = ["--frames", "1", "--fps", "24", "--device", "cpu"]
    done = balloon_warp(ball, "run", "ball.obj", "-o", "[red].usda", *options)
    assert done.stdout.startswith("ball: 56 particles, 312 springs, 1 frame of ")
    assert done.stdout.splitlines()[1] == "wrote [red].usda: 0.0417 s at 24 frames/s"


@pytest.mark.full
def test_run_json_is_one_object_with_the_promised_keys(ball: Path):
    done = balloon_warp(ball, "run", "ball.obj", "-o", "out.usda", "--json", "--set", "frames=2", "--device", "cpu")
    summary = json.loads(done.stdout)
    assert list(summary) == SUMMARY_KEYS
    (said,) = summary["inflation"]
    assert f"auto pressure {said['pressure']:.4g} Pa, volume 1.00 -> {said['volume']:.2f}" in SECOND_LINE
    assert [summary[key] for key in ("output", "picture", "points", "scene")] == ["out.usda", None, None, "ball"]
    assert (summary["frames"], summary["worlds"], summary["particles"], summary["device"]) == (2, 1, 56, "cpu")


def test_scenes_are_listed_a_line_each(tmp_path: Path):
    done = balloon_warp(tmp_path, "scenes")
    assert done.returncode == 0
    assert "squirrel_tether" in done.stdout
    assert len(done.stdout.splitlines()) == 1 + len(bundled_scenes())


def test_a_scene_of_ones_own_begins_with_that_of_a_mesh(ball: Path):
    """The scene file that `scenes` writes for a mesh equals the scene that `run` makes of it."""
    (ball / "mine").mkdir()
    done = balloon_warp(ball, "scenes", "ball.obj", "-o", "mine/mine.toml")
    assert (done.returncode, done.stdout) == (0, "wrote mine/mine.toml\n"), done.stderr
    mesh = {"balloon.mesh": str(ball / "ball.obj")}
    assert load_scene(ball / "mine" / "mine.toml", mesh) == load_scene(ball / "ball.obj")
    printed = balloon_warp(ball, "scenes", "ball.obj").stdout
    assert '\nmesh = "ball.obj"\n' in printed  # where it is seen from here


@pytest.mark.full
def test_remesh_writes_quads_that_run_can_inflate(ball: Path):
    done = balloon_warp(ball, "remesh", "ball.obj", "-o", "quads.obj", "--cells", "8")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("wrote quads.obj: ")
    assert (read_obj(ball / "quads.obj").face_vertex_counts == 4).all()


@pytest.mark.parametrize(
    "named", [[], ["run"], ["compare"], ["scenes"], ["inspect"], ["remesh"], ["foil"], ["render"], ["convert"]]
)
def test_help_explains_itself(command: Callable, named: list[str]):
    done = command(*named, "--help")
    assert done.returncode == 0
    assert "Usage: " in done.stdout


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["run", "zebra"], "zebra: no such scene or file; bundled scenes are airbag, balloon_bunch, "),
        (["run", "ball.obj", "-o", "film.mp4"], ".pvd; `balloon-warp render` renders pictures and films"),
        (["run", "--fps"], "error: --fps: has no value; expected --fps RATE; balloon-warp run --help explains\n"),
        (["run", "ball.txt"], "ball.txt: "),
        (["scenes", "-o", "mine.toml"], "--output mine.toml: needs a SCENE to write"),
        (["scenes", "squirrel_tether", "-o", "mine.txt"], "mine.txt: cannot write .txt; expected .toml"),
        (["run", "broken.obj"], "broken.obj, line 1: "),
        (["run", "bad.toml"], "bad.toml: frames: must be greater than or equal to 1 (got 0)"),
        (
            ["run", "ball.obj", "--set", "balloon.mass=-1"],
            "error: --set balloon.mass: balloon.0.mass: must be greater than 0",
        ),
        (
            ["run", "squirrel_inflate", "--set", "frames=9", "--set", "substep=1"],
            "error: --set substep: unknown field; did you mean substeps?",
        ),
        (["run", "bad.toml", "--set", "substeps=0"], "bad.toml: frames: must be greater than or equal to 1 (got 0)"),
        (["run", "ball.obj", "--set", "substeps=1"], "substeps: 1 are too few for these springs and masses"),
        (["run", "ball.obj", "--device", "cuda:77"], "--device cuda:77: no such device; this machine has cpu"),
        (["run", "ball.obj", "-o", "nowhere/out.usdc"], "nowhere/out.usdc: the folder nowhere does not exist"),
        (["run", "ball.usda", "-o", "ball.usda"], "ball.usda: is the scene's mesh; expected another name"),
        (["run", "ball.obj", "-o", "out.png"], "out.png: cannot write .png; expected .usdc, .usda, .usd"),
        (["inspect", "missing.obj"], "missing.obj: "),
        (["remesh", "ball.obj", "-o", "out.stl"], "out.stl: cannot write .stl; expected .obj"),
        (["foil", "L", "-o", "out.stl"], "out.stl: cannot write .stl; expected .obj, .toml"),
        (["foil", " ", "-o", "out.obj"], "text: has no visible character (got ' '); expected letters, or an .svg file"),
        (["foil", "missing.svg", "-o", "out.obj"], "missing.svg: cannot be read: No such file or directory"),
        (["render", "missing.usdc"], "missing.usdc: "),
        (["convert", "missing.usdc", "-o", "out.glb"], "missing.usdc: "),
        (["convert", "ball.obj", "-o", "out.ply"], "out.ply: is one file for all frames; expected #### in the name"),
        (["run", "ball.obj", "-o", "out.fbx"], "out.fbx: cannot write .fbx; expected .usdc, "),
        (["render", "ball.obj", "--size", "big"], "size: 'big'; expected WIDTHxHEIGHT"),
    ],
)
def test_a_mistake_gets_one_sentence_and_status_2(ball: Path, command: Callable, arguments: list[str], sentence: str):
    (ball / "broken.obj").write_text("v 1 2\nf 1 1 1\n")
    (ball / "ball.txt").write_text("not a mesh")
    (ball / "ball.usda").write_text(ONE_FACE)
    (ball / "bad.toml").write_text("frames = 0\n[[balloon]]\nmesh = 'ball.obj'\n")
    before = {path: path.read_bytes() for path in ball.iterdir()}
    done = command(*arguments)
    assert done.returncode == 2
    assert done.stdout == ""
    assert sentence in done.stderr
    assert done.stderr.startswith("error: ")
    assert len(done.stderr.splitlines()) == 1
    assert {path: path.read_bytes() for path in ball.iterdir()} == before


def test_a_mistake_ends_a_process_of_its_own_with_one_sentence_and_status_2(ball: Path):
    """Bad input prints one sentence and nothing else, by a loading library or an ending process either."""
    done = balloon_warp(ball, "run", "ball.obj", "--set", "balloon.mass=-1")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: --set balloon.mass: balloon.0.mass: must be greater than 0")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.full
def test_a_blow_up_gets_one_sentence_and_status_1(tmp_path: Path):
    """A blow-up beyond float32 prints one sentence: springs are stable, but nothing holds the balloon."""
    write_obj(tmp_path / "box.obj", cube())
    done = balloon_warp(tmp_path, "run", "box.obj", "--device", "cpu", "--set", "balloon.inflation.k_normal=9e11")
    assert done.returncode == 1
    assert "\nerror: the simulation blew up in frame 1, world 0, substep 1 of " in done.stderr
    assert "inflation pushed it with 1.5e+13 N" in done.stderr
    assert len(done.stderr.splitlines()) == 2
    assert done.stderr.startswith("note: box.obj inflates above a floor. ")
    assert [path.name for path in tmp_path.iterdir()] == ["box.obj"]


@pytest.mark.full
@pytest.mark.parametrize(
    ("command", "number", "status"),
    [("run", signal.SIGINT, 130), ("run", signal.SIGTERM, 143), ("batch", signal.SIGINT, 130)],
)
def test_a_stopped_run_says_how_far_it_got_and_leaves_no_output(ball: Path, command: str, number: int, status: int):
    words = [command, "ball.obj", "-o", "out" if command == "batch" else "out.usdc", "--set", "frames=1000000"]
    how = ["--device", "cpu", "--schedule", "gather", "--checkpoint", "0.05"]
    process = subprocess.Popen(
        [sys.executable, "-m", "balloon_warp", *words, *how],
        cwd=ball,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "NO_COLOR": "1"},
    )
    try:
        while process.poll() is None and not list(ball.rglob("state_*.npz")):  # until it simulates
            time.sleep(0.1)
        process.send_signal(number)
        said = process.communicate(timeout=300)
    finally:
        process.kill()
    assert process.returncode == status
    left = r"out\.usdc\.partial/frames\.usda plays the frames so far, and --resume continues from them"
    if command == "batch":
        left = r"out/partial holds the frames so far, and --resume continues from them"
    assert re.fullmatch(
        rf"{FIRST_LINE}.*\n(?:{SECOND_LINE}\n)?error: ball was interrupted after frame \d+ of 1000000; {left}\n",
        said[1],
    )
    assert said[0] == ""
    assert [path.name for path in ball.iterdir() if path.suffix != ".partial" and path.is_file()] == ["ball.obj"]


def test_importing_the_package_loads_nothing_heavy(tmp_path: Path):
    program = "import sys, balloon_warp; print([m for m in ('warp', 'pxr', 'trimesh', 'PIL') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.stdout.strip() == "[]"


def test_a_command_does_not_look_for_garbage_in_what_it_loaded(tmp_path: Path):
    program = (
        "import gc, sys; from balloon_warp.__main__ import main; looked = []\n"
        "gc.callbacks.append(lambda phase, about: looked.append(about['generation']))\n"
        "sys.argv[1:] = ['scenes']\n"
        "try: main()\n"
        "finally: print(any(looked), gc.get_freeze_count() > 100_000, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.stderr.strip() == "False True"


@pytest.mark.full
def test_a_batch_of_one_process_that_exports_nothing_loads_no_usd_and_no_event_loop(tmp_path: Path):
    write_obj(tmp_path / "ball.obj", quad_sphere(2))
    program = (
        "import sys, balloon_warp; balloon_warp.run_batch('ball.obj', 'out', 2, device='cpu')\n"
        "print({'pxr', 'trimesh', 'asyncio'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.stdout.strip() == "set()"

"""Command line: commands, options, mistakes, terminals and logs."""

import contextlib
import io
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from subprocess import PIPE

import pytest
from commands import status_of
from meshes import cube, quad_sphere
from PIL import Image
from rich.console import Console
from rich.table import Table

import balloon_warp as package
from balloon_warp import bundled_scenes, load_scene
from balloon_warp.cli import progress as console
from balloon_warp.cli.options import Changes, LengthOptions
from balloon_warp.cli.progress import FrameProgress, counted
from balloon_warp.mesh.obj import write_obj
from balloon_warp.tools import doctor

SUMMARY_KEYS = """output picture points scene device schedule worlds particles springs frames begin frames_per_second
substeps restarts blow_up bad_endings inflation strain_bound wall_seconds particle_substeps_per_second"""
ONE_FACE = """#usda 1.0
def Mesh "face"
{
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
}
"""


def process(folder: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    words, around = [sys.executable, *arguments], {**os.environ, "NO_COLOR": "1", "COLUMNS": "200", **environment}
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=600, env=around)


def balloon_warp(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return process(folder, "-m", "balloon_warp", *arguments)


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Callable:
    """Run the command line in this process, to test its output and not how a process starts."""
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.chdir(tmp_path)

    def ended(words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(words, status_of(*shlex.split(words)), *capfd.readouterr())

    return ended


FIRST_LINE = "note: ball.obj inflates above a floor. Unit unknown"
COARSE = "note: ball is coarse and shows its faces (56 particles, faces up to 0.27 of its size): balloon-warp remesh "
SECOND_LINE = "note: auto pressure 37.01 Pa, volume 1.00 -> 1.26"


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    write_obj(tmp_path / "ball.obj", quad_sphere(3))
    return tmp_path


@pytest.mark.full
def test_run_writes_stage_and_picture_and_says_where(ball: Path):
    done = balloon_warp(ball, "run", "ball.obj", "--picture", "--set", "frames=3", "--device", "cpu")
    assert done.returncode == 0, done.stderr
    first, coarse, *others = done.stderr.splitlines()
    assert first.startswith(FIRST_LINE)
    assert coarse == f"{COARSE}--cells 32 makes them small and even"
    assert others == [SECOND_LINE]  # no bar in a pipe, no word of Warp's
    assert done.stdout.splitlines()[1:] == [
        "wrote ball.usdc: 0.05 s at 60 frames/s; in Blender, set the frame rate to 60, or run with --fps 24",
        "wrote ball.png",
    ]
    assert done.stdout.startswith("ball: 56 particles, 312 springs, 3 frames of ")
    assert sorted(path.name for path in ball.iterdir()) == ["ball.obj", "ball.png", "ball.usdc"]
    assert Image.open(ball / "ball.png").size == (960, 540)


@pytest.mark.full
def test_run_json_is_one_object_with_the_promised_keys(ball: Path):
    done = balloon_warp(ball, "run", "ball.obj", "-o", "out.usda", "--json", "--set", "frames=2", "--device", "cpu")
    summary = json.loads(done.stdout)
    assert list(summary) == SUMMARY_KEYS.split()
    (said,) = summary["inflation"]
    assert f"auto pressure {said['pressure']:.4g} Pa, volume 1.00 -> {said['volume']:.2f}" in SECOND_LINE
    assert [summary[key] for key in ("output", "picture", "points", "scene")] == ["out.usda", None, None, "ball"]
    assert (summary["frames"], summary["worlds"], summary["particles"], summary["device"]) == (2, 1, 56, "cpu")


def test_scenes_are_listed_a_line_each(command: Callable):
    done = command("scenes")
    assert done.returncode == 0
    assert "squirrel_tether" in done.stdout
    assert len(done.stdout.splitlines()) == 1 + len(bundled_scenes())


def test_a_scene_of_ones_own_begins_with_that_of_a_mesh(ball: Path, command: Callable):
    (ball / "mine").mkdir()
    done = command("scenes ball.obj -o mine/mine.toml")
    assert (done.returncode, done.stdout) == (0, "wrote mine/mine.toml\n"), done.stderr
    mesh = {"balloon.mesh": str(ball / "ball.obj")}
    assert load_scene(ball / "mine" / "mine.toml", mesh) == load_scene(ball / "ball.obj")
    assert '\nmesh = "ball.obj"\n' in command("scenes ball.obj").stdout  # where it is seen from here


HELP = {f"{name} --help": "Usage: " for name in ("", "run", "compare", "scenes", "inspect", "remesh", "foil", "render")}
HELP |= {"convert --help": "Usage: ", "": "balloon-warp run squirrel_tether --picture"}
HELP |= {"fit --help": "'volume [ml], pressure [kPa]'"}


UNSAID = {"run --help": "--zoom", "render --help": "to simulate on"}
"""what the help of a command leaves to others"""


@pytest.mark.parametrize(("words", "said"), HELP.items())
def test_help_explains_itself_and_is_printed_without_a_command(command: Callable, words: str, said: str):
    done = command(words)
    assert done.returncode == 0
    assert said in done.stdout
    assert words not in UNSAID or UNSAID[words] not in done.stdout


MISTAKES = [
    ("run zebra", "zebra: no such scene or file; bundled scenes are airbag, balloon_bunch, "),
    ("run ball.obj -o film.mp4", "….pvd; `balloon-warp render` renders pictures and films"),
    ("run ball.obj --set balloon.mass=-1", "--set balloon.mass: balloon.0.mass: must be greater than 0"),
    ("run squirrel_inflate --set frames=9 --set substep=1", "--set substep: unknown field; did you mean substeps?"),
    ("run ball.obj --set substeps=1", "…substeps: 1 are too few for these springs and masses"),
    ("run ball.obj --device cuda:77", "--device cuda:77: no such device; this machine has cpu"),
    ("run ball.usda -o ball.usda", "ball.usda: is the scene's mesh; expected another name"),
    ("run --fps", "--fps: has no value; expected --fps RATE; balloon-warp run --help explains"),
    ("run ball.obj --picture=3", "--picture: takes no value; balloon-warp run --help explains"),
    ("run ball.obj --zoom 2", "--zoom: needs --picture"),
    ("run ball.obj --pictur", "--pictur: unknown option of run; did you mean --picture?"),
    ("run ball.obj --duration 3", "--duration: unknown option of run; did you mean --seconds?"),
    ("run ball.obj --gravity=3", "--gravity=3: unknown option of run; did you mean --set gravity=?"),
    ("run ball.obj -frames 3", "-frames: unknown option of run; did you mean --frames?"),
    ("compare ball.obj --vary gravity=1:3", "--vary gravity=1:3: takes values, as in --vary gravity=1,3; ranges "),
    ("ball.obj", "ball.obj: no such command; did you mean balloon-warp run ball.obj?"),
    ("rnu ball.obj", "rnu: no such command; did you mean run?"),
    ("xyz run ball.obj", "xyz: no such command; commands are run, view, batch, compare, "),
    ("--vers", "--vers: unknown option of balloon-warp; did you mean --version?"),
    ("run", "run: SCENE is missing; balloon-warp run --help explains"),
    ("render bal.usdc", "bal.usdc: no such file; expected a USD stage"),
    ("remesh ball.obj", "remesh: --output is missing; balloon-warp remesh --help explains"),
    ("run ball.obj --picture --shutter 2", "shutter: 2; expected 0 to 1 of a frame"),
    ("run ball.obj --picture --look-at Ball", "look-at: 'Ball' is not visible in ball.usdc; did you mean"),
    ("run ball.obj --vary gravity=1,2", "--vary: unknown option of run; `batch` and `compare` have it; balloon"),
    (
        "run ball.obj --parts free",
        "--parts free: expected all, closed, largest; did you mean --set balloon.parts=free?",
    ),
    ("run ball.obj balloon.mass=3", "run: did not expect balloon.mass=3; --set goes before PATH=VALUE; balloon-"),
    ("run ball.obj --frames few", "--frames: must be a valid integer (got few); balloon-warp run --help explains"),
    ("run ball.obj --frames 3 --seconds 1", "--frames, --seconds: expected only one of them"),
    ("inspect ball.obj --set baloon.mass=1", "--set baloon.mass: baloon: unknown table; did you mean balloon?"),
    ("compare ball.obj", "--vary: is missing; expected a value to vary, as in --vary normals="),
]
"""words, and the beginning of the sentence, or a part of it after …"""


@pytest.mark.parametrize(("words", "sentence"), MISTAKES)
def test_a_mistake_gets_one_sentence_and_status_2(ball: Path, command: Callable, words: str, sentence: str):
    (ball / "ball.usda").write_text(ONE_FACE)
    before = {path: path.read_bytes() for path in ball.iterdir()}
    done = command(words)
    assert (done.returncode, done.stdout) == (2, "")
    (mistake,) = done.stderr.splitlines()
    assert sentence[1:] in mistake if sentence[0] == "…" else mistake.startswith(f"error: {sentence}")
    assert mistake.startswith("error: ")
    assert {path: path.read_bytes() for path in ball.iterdir()} == before


@pytest.mark.full
def test_a_blow_up_gets_one_sentence_and_status_1(tmp_path: Path):
    write_obj(tmp_path / "box.obj", cube())
    done = balloon_warp(tmp_path, "run", "box.obj", "--device", "cpu", "--set", "balloon.inflation.k_normal=9e11")
    note, _coarse, error = done.stderr.splitlines()
    assert done.returncode == 1
    assert note.startswith("note: box.obj inflates above a floor. ")
    assert error.startswith("error: the simulation blew up in frame 1, world 0, substep 1 of ")
    assert "inflation pushed it with 1.5e+13 N" in error
    assert [path.name for path in tmp_path.iterdir()] == ["box.obj"]


@pytest.mark.full
@pytest.mark.parametrize(
    ("words", "number", "status", "left"),
    [
        ("run ball.obj -o out.usdc", signal.SIGINT, 130, r"out\.usdc\.partial/frames\.usda plays"),
        ("run ball.obj -o out.usdc", signal.SIGTERM, 143, r"out\.usdc\.partial/frames\.usda plays"),
        ("batch ball.obj -o out", signal.SIGINT, 130, r"out/partial holds"),
    ],
)
def test_a_stopped_run_says_how_far_it_got_and_leaves_no_output(ball: Path, words, number: int, status: int, left: str):
    how = "--set frames=1000000 --device cpu --schedule gather --checkpoint 0.05"
    command = [sys.executable, "-m", "balloon_warp", *words.split(), *how.split()]
    plain = {**os.environ, "NO_COLOR": "1"}
    process = subprocess.Popen(command, cwd=ball, stdout=PIPE, stderr=PIPE, text=True, env=plain)
    try:
        while process.poll() is None and not list(ball.rglob("state_*.npz")):  # until it simulates
            time.sleep(0.1)
        process.send_signal(number)
        said = process.communicate(timeout=300)
    finally:
        process.kill()
    assert process.returncode == status
    stopped = rf"ball was interrupted after frame \d+ of 1000000; {left} the frames so far, and --resume continues"
    assert re.fullmatch(rf"{FIRST_LINE}.*\n(?:note: .*\n)*error: {stopped} from them\n", said[1])
    assert said[0] == ""
    assert [path.name for path in ball.iterdir() if path.suffix != ".partial" and path.is_file()] == ["ball.obj"]


PARQUET = """from balloon_warp.batch.table import ParquetRows
import pathlib, numpy as np
rows = ParquetRows(pathlib.Path('rows.parquet'), ['world', 'frame', 'time', 'a', 'health'], {}, 2)
rows.write(3, 0.5, np.array([[4.0, 5.0]], np.float32), np.array([0, 1], np.int32))
rows.close()"""
INSPECT = "from balloon_warp.cli.app import app; app(['inspect', 'ball.obj'], standalone_mode=False)"
BATCH = "import balloon_warp; balloon_warp.run_batch('ball.obj', 'out', 2, device='cpu')"


@pytest.mark.parametrize(
    ("program", "heavy"),
    [
        pytest.param("import balloon_warp", {"warp", "pxr", "trimesh", "PIL"}, id="the package"),
        pytest.param(PARQUET, {"pandas"}, id="a table of Parquet"),
        pytest.param(INSPECT, {"pxr", "trimesh"}, id="inspect an .obj", marks=pytest.mark.full),
        pytest.param(BATCH, {"pxr", "trimesh", "asyncio"}, id="a batch without a stage", marks=pytest.mark.full),
    ],
)
def test_a_process_imports_the_package_under_test_and_nothing_heavy(program: str, heavy: set[str], ball: Path):
    tell = f"import sys, balloon_warp; print({heavy} & set(sys.modules), balloon_warp.__path__[0])"
    done = process(ball, "-c", f"{program}\n{tell}")
    loaded, _, place = done.stdout.splitlines()[-1].partition(" ")
    assert (loaded, Path(place)) == ("set()", Path(package.__path__[0]).resolve()), done.stderr


@pytest.mark.full
def test_a_run_on_a_terminal_shows_frames_a_second(ball: Path):
    pty = pytest.importorskip("pty", reason="needs pseudo-terminals")
    terminal, end = pty.openpty()
    words = [sys.executable, "-m", "balloon_warp", "run", "ball.obj", "--device", "cpu", "--set", "frames=40"]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "200"}
    running = subprocess.Popen(words, cwd=ball, stdout=PIPE, stderr=end, text=True, env=environment)
    os.close(end)
    shown = b""
    with contextlib.suppress(OSError):  # how Linux says that the other end has closed
        while part := os.read(terminal, 65536):
            shown += part
    os.close(terminal)
    printed, _ = running.communicate(timeout=120)
    assert running.returncode == 0
    assert [line.partition(":")[0] for line in printed.splitlines()[1:]] == ["wrote ball.usdc"]
    assert b"40/40" in shown
    assert any(int(rate) > 0 for rate in re.findall(rb"(\d+) frames/s", shown))


def logged(monkeypatch: pytest.MonkeyPatch, total: int, seconds: Iterable[tuple[int, float]]) -> list[str]:
    """Return the lines of a log of so many frames, of which some end after so many seconds more."""
    now, log = [100.0], io.StringIO()
    monkeypatch.setattr("balloon_warp.cli.progress.time.monotonic", lambda: now[0])
    with FrameProgress(Console(file=log)) as progress:
        progress.get_time = lambda: now[0]
        task = progress.add_task("squirrel", total=total)
        for frame, more in seconds:
            now[0] += more
            progress.update(task, completed=frame)
    assert log.getvalue().isascii()
    return log.getvalue().splitlines()


def test_a_log_gets_a_line_now_and_then(monkeypatch: pytest.MonkeyPatch):
    """Every half minute, not counting the frame in which kernels compile, or half a minute would become twenty."""
    lines = logged(monkeypatch, 1200, ((frame, 1.0) for frame in range(0, 1200, 10)))
    assert lines[0] == "squirrel: about 2 min (1,170 frames at 10 frames/s)"
    assert lines[1] == "squirrel: frame 290 of 1,200, 10 frames/s, 91 s left"
    assert len(lines) == 1 + 4  # of two minutes
    compiled = ((frame, 31.0 if frame == 1 else float(frame > 0)) for frame in range(48))
    expected = ["squirrel: frame 1 of 48", "squirrel: frame 31 of 48, 1 frames/s, 17 s left"]
    assert logged(monkeypatch, 48, compiled) == expected


@pytest.mark.full
@pytest.mark.parametrize(
    ("words", "opening", "worlds"),
    [
        ("run ball.toml", "ball: ", 1),
        ("run ball.obj", r"note: ball\.obj inflates above a floor\. .*--up Z turns it\. ", 1),
        ("batch ball.toml --worlds 3 --vary balloon.mass=1:2", "ball: ", 3),
        ("compare ball.toml --vary balloon.mass=1,2", "ball, run 1 of 2: ", 1),
    ],
)
def test_the_first_line_of_a_log(ball: Path, command: Callable, words: str, opening: str, worlds: int):
    (ball / "ball.toml").write_text('[[balloon]]\nmesh = "ball.obj"\n')
    first, *_ = command(f"{words} --frames 2 --device cpu --schedule gather").stderr.splitlines()
    what = rf"{counted(worlds, 'world')}, {56 * worlds} particles, \d+ substeps? a frame, 2 frames at 60 frames/s"
    assert re.fullmatch(rf"{opening}{what}, on cpu, schedule gather", first)


def test_names_in_lines_and_tables_are_text_and_colors_stay():
    file = io.StringIO()
    ours = console.Console(file=file, force_terminal=True, color_system="standard", width=100, highlight=False)
    table = Table()
    table.add_row("\x1b]0;cell")
    ours.print("[red]warning:[/] \x1b]0;line a\x9b31mb a\u202eb \u00fcber", table)
    text = file.getvalue()
    assert "\x1b]" not in text
    assert text.startswith("\x1b[31mwarning:\x1b[0m \\x1b]0;line a\\x9b31mb a\\u202eb \u00fcber\n")
    assert text.count("\\x1b]0;") == 2


@pytest.mark.full
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere names are no bytes")
def test_names_and_logs_that_are_not_utf8_cost_no_work(tmp_path: Path):
    mesh = os.fsdecode(b"b\xe9.obj")
    write_obj(tmp_path / "ball.obj", quad_sphere(2))
    os.rename(tmp_path / "ball.obj", tmp_path / mesh)
    command = [sys.executable, "-m", "balloon_warp", "run", mesh, "--device", "cpu", "--frames", "1", "--json"]
    environment = {**os.environ, "PYTHONIOENCODING": "cp1252"}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["output"] == "b_.usdc"
    assert (tmp_path / "b_.usdc").exists()
    (folder := tmp_path / os.fsdecode(b"f\xe9")).mkdir()
    os.rename(tmp_path / mesh, folder / "ball.obj")
    done = subprocess.run([*command[:4], "ball.obj"], cwd=folder, env=environment, capture_output=True, timeout=120)
    assert done.returncode == 2
    assert done.stderr == b"error: ball.usdc: the path is not UTF-8; expected one that is, with -o\n"


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
def test_options_give_rate_and_frames_and_count_for_more_than_what_is_set(ball: Path, options, rate, frames):
    scene = Changes(length=LengthOptions(**options)).load(str(ball / "ball.obj"))
    assert (scene.frames_per_second, scene.frames) == (rate, frames)
    length = LengthOptions(fps=25.0, frames=8)
    scene = Changes(["frames=7", "frames_per_second=30"], length=length).load(str(ball / "ball.obj"))
    assert (scene.frames_per_second, scene.frames) == (25.0, 8)


@pytest.fixture(scope="module")
def report() -> doctor.Report:
    return doctor.examine("cpu")


def test_the_balloon_falls_by_the_formula_and_grows(report: doctor.Report):
    """The fall agrees with the formula within float32's sum over substeps: the command's bound is ten times that."""
    assert report.self_test.passed
    assert report.self_test.fallen == pytest.approx(report.self_test.expected, rel=1e-5)
    assert report.self_test.expected == pytest.approx(9.81 / 2, rel=0.05)
    assert report.self_test.grown > 1.5


@pytest.mark.parametrize("wrong", [{"fallen": 4.0}, {"fallen": float("nan")}, {"grown": 1.0}, {"grown": float("nan")}])
def test_a_balloon_that_does_otherwise_fails(report: doctor.Report, wrong: dict[str, float]):
    assert not replace(report.self_test, **wrong).passed


def test_extras_are_missing_where_a_package_of_theirs_is(report: doctor.Report, monkeypatch: pytest.MonkeyPatch):
    assert {"bench", "cluster", "docs", "foil", "test", "video", "view"} <= report.missing.keys()
    assert report.missing["test"] == []
    wanted = ["warp-lang>=1.19", "no-such-package>=2; extra == 'view'", 'numpy>=1.26; extra == "view"']
    monkeypatch.setattr(metadata, "requires", lambda name: [*wanted, "numpy; extra == 'foil'"])
    assert doctor.missing_extras() == {"foil": [], "view": ["no-such-package"]}


def test_doctor_says_what_there_is(report: doctor.Report, monkeypatch: pytest.MonkeyPatch, command: Callable):
    found = replace(report, missing={"video": ["imageio-ffmpeg"], "view": []})
    monkeypatch.setattr(doctor, "examine", lambda device: found)
    done = command("doctor")
    lines = [f"warp-lang {metadata.version('warp-lang')}", "device         cpu (CPU)", "self-test      passed in "]
    lines += ["extra video    missing imageio-ffmpeg: pip install 'balloon-warp[video]'\n"]
    lines += ["extra view     installed\n"]
    assert [line for line in lines if line not in done.stdout] == []
    assert done.returncode == 0


def test_a_failed_test_ends_with_status_1(report: doctor.Report, monkeypatch: pytest.MonkeyPatch, command: Callable):
    broken = replace(report, self_test=replace(report.self_test, fallen=4.0))
    monkeypatch.setattr(doctor, "examine", lambda device: broken)
    done, as_json = command("doctor"), command("doctor --json")
    assert (done.returncode, as_json.returncode) == (1, 1)
    assert "self-test      FAILED in " in done.stdout
    assert json.loads(as_json.stdout)["passed"] is False


def test_the_version_is_the_package_s(command: Callable):
    done = command("--version")
    assert (done.returncode, done.stdout.strip()) == (0, metadata.version("balloon-warp"))

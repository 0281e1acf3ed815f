"""Command line on a terminal, and the package that a process of its own imports."""

import io
import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from meshes import quad_sphere
from rich.console import Console

import balloon_warp
from balloon_warp.beginning import Beginning
from balloon_warp.cli.app import app
from balloon_warp.cli.estimate import FirstEstimate, time_left
from balloon_warp.cli.progress import FrameProgress
from balloon_warp.cli.words import counted
from balloon_warp.mesh.obj import write_obj


def read_all(terminal: int) -> str:
    """Return the text written to a pseudo-terminal until its other end closed."""
    parts = []
    while True:
        try:
            part = os.read(terminal, 65536)
        except OSError:  # how Linux says that the other end has closed
            part = b""
        if not part:
            return b"".join(parts).decode()
        parts.append(part)


def test_a_process_of_its_own_runs_the_package_under_test(tmp_path: Path):
    program = "import balloon_warp; print(balloon_warp.__path__[0])"
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert Path(done.stdout.strip()) == Path(balloon_warp.__path__[0]).resolve()


@pytest.mark.full
def test_a_run_on_a_terminal_shows_frames_a_second(tmp_path: Path):
    """A terminal shows frames a second on standard error; standard output is that of a pipe."""
    pty = pytest.importorskip("pty", reason="needs pseudo-terminals")
    write_obj(tmp_path / "ball.obj", quad_sphere(3))
    terminal, end = pty.openpty()
    command = [sys.executable, "-m", "balloon_warp", "run", "ball.obj", "--device", "cpu", "--set", "frames=40"]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "200"}
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=end, text=True, env=environment)
    os.close(end)
    shown = read_all(terminal)
    os.close(terminal)
    printed, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    assert [line.partition(":")[0] for line in printed.splitlines()[1:]] == ["wrote ball.usdc"]
    assert "40/40" in shown
    assert any(int(rate) > 0 for rate in re.findall(r"(\d+) frames/s", shown))


def test_a_log_gets_a_line_now_and_then(monkeypatch: pytest.MonkeyPatch):
    """A log gets a line of progress, speed and time left after every half minute."""
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    log = io.StringIO()
    with FrameProgress(Console(file=log)) as progress:
        progress.get_time = lambda: now[0]
        task = progress.add_task("squirrel", total=1200)
        for frame in range(0, 1200, 10):
            now[0] += 1.0
            progress.update(task, completed=frame)
    lines = log.getvalue().splitlines()
    assert lines[0] == "squirrel: about 2 min (1,170 frames at 10 frames/s)"
    assert lines[1] == "squirrel: frame 290 of 1,200, 10 frames/s, 91 s left"
    assert len(lines) == 1 + 4  # of two minutes
    assert log.getvalue().isascii()


def test_a_log_does_not_count_the_frame_in_which_kernels_are_compiled(monkeypatch: pytest.MonkeyPatch):
    """The estimate excludes the frame in which kernels compile, or half a minute would become twenty."""
    now, log = [0.0], io.StringIO()
    monkeypatch.setattr("balloon_warp.cli.progress.time.monotonic", lambda: now[0])
    with FrameProgress(Console(file=log)) as progress:
        progress.get_time = lambda: now[0]
        task = progress.add_task("squirrel", total=48)
        progress.update(task, completed=0)
        for frame in range(1, 48):
            now[0] += 31.0 if frame == 1 else 1.0
            progress.update(task, completed=frame)
    assert log.getvalue().splitlines() == ["squirrel: frame 1 of 48", "squirrel: frame 31 of 48, 1 frames/s, 17 s left"]


BEGINNING = Beginning(
    worlds=1,
    particles=2494,
    frames=600,
    substeps=13,
    frames_per_second=60.0,
    device="cpu",
    schedule="octets",
)


def test_a_log_says_first_what_is_simulated():
    with FrameProgress(Console(file=io.StringIO())) as progress:
        task = progress.add_task("squirrel", total=600)
        said = [progress.begin(task, each) for each in (BEGINNING, replace(BEGINNING, worlds=64, workers=2))]
    what = "2,494 particles, 13 substeps a frame, 600 frames at 60 frames/s"
    assert said == [
        f"1 world, {what}, on cpu, schedule octets",
        f"64 worlds, {what}, on 2 x cpu, schedule octets",
    ]


def test_a_bar_has_what_a_frame_costs_beside_it():
    screen = io.StringIO()
    with FrameProgress(Console(file=screen, force_terminal=True, width=200)) as progress:
        assert progress.begin(progress.add_task("squirrel", total=600), BEGINNING) is None
    shown = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", screen.getvalue())
    assert "squirrel 2,494 particles, 13 substeps a frame" in shown


@pytest.mark.parametrize(
    ("words", "opening", "worlds"),
    [
        (["run", "ball.toml"], "ball: ", 1),
        (["run", "ball.obj"], r"note: ball\.obj inflates above a floor\. .*--up Z turns it\. ", 1),
        (["batch", "ball.toml", "--worlds", "3", "--vary", "balloon.mass=1:2"], "ball: ", 3),
        (["compare", "ball.toml", "--vary", "balloon.mass=1,2"], "ball, run 1 of 2: ", 1),
    ],
)
def test_the_first_line_of_a_log(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    opening: str,
    worlds: int,
):
    """The first line of a log describes the simulation, before notes and after a mesh's default scene."""
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path / "ball.obj", quad_sphere(3))
    (tmp_path / "ball.toml").write_text('[[balloon]]\nmesh = "ball.obj"\n')
    app([*words, "--frames", "2", "--device", "cpu", "--schedule", "gather"], standalone_mode=False)
    first, *_ = capsys.readouterr().err.splitlines()
    what = rf"{counted(worlds, 'world')}, {56 * worlds} particles, \d+ substeps? a frame, 2 frames at 60 frames/s"
    assert re.fullmatch(rf"{opening}{what}, on cpu, schedule gather", first)


@pytest.mark.parametrize(
    ("frames", "seconds", "left", "said"),
    [
        (8, 10.0, 600, "about 12 min (600 frames at 0.8 frames/s)"),
        (3, 90.0, 200, "about 1 h 40 min (200 frames at 0.033 frames/s)"),
        (3, 900.0, 1000, "about 3 d 11 h (1,000 frames at 0.0033 frames/s)"),
        (1000, 2.0, 90_000, "about 3 min (90,000 frames at 500 frames/s)"),
        (2, 100.0, 600, None),  # too few
        (90, 1.0, 90_000, None),  # too soon
        (100, 10.0, 500, None),  # soon done
        (0, 0.0, 10, None),
    ],
)
def test_time_left(frames: int, seconds: float, left: int, said: str | None):
    assert time_left(frames, seconds, left) == said


def test_the_time_is_estimated_once_and_without_what_is_compiled():
    estimate = FirstEstimate()
    said = [estimate.after(0, 100, 0.0), estimate.after(1, 100, 60.0)]  # a minute of compiling
    said += [estimate.after(frame, 100, 60.0 + 2.0 * (frame - 1)) for frame in range(2, 101)]
    assert [each for each in said if each] == ["about 3 min (96 frames at 0.5 frames/s)"]


def test_a_run_that_begins_again_is_estimated_anew():
    estimate = FirstEstimate()
    assert [estimate.after(frame, 100, 0.1 * frame) for frame in range(20)] == [None] * 20
    again = [estimate.after(frame, 100, 100.0 + 2.0 * frame) for frame in range(6)]
    assert [each for each in again if each] == ["about 3 min (96 frames at 0.5 frames/s)"]


@pytest.mark.full
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere names are no bytes")
def test_names_and_logs_that_are_not_utf8_cost_no_work(tmp_path: Path):
    """A mesh with a Latin-1 name is simulated under a valid USD name, and reported in a log of any encoding."""
    mesh = os.fsdecode(b"b\xe9.obj")
    write_obj(tmp_path / "ball.obj", quad_sphere(2))
    os.rename(tmp_path / "ball.obj", tmp_path / mesh)
    command = [sys.executable, "-m", "balloon_warp", "run", mesh, "--device", "cpu", "--frames", "1", "--json"]
    environment = {**os.environ, "PYTHONIOENCODING": "cp1252"}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["output"] == "b_.usdc"
    assert (tmp_path / "b_.usdc").exists()
    folder = tmp_path / os.fsdecode(b"f\xe9")
    folder.mkdir()
    os.rename(tmp_path / mesh, folder / "ball.obj")
    done = subprocess.run([*command[:4], "ball.obj"], cwd=folder, env=environment, capture_output=True, timeout=120)
    assert done.returncode == 2
    assert done.stderr == b"error: ball.usdc: the path is not UTF-8; expected one that is, with -o\n"

"""The command line on a terminal, and which package a process of its own runs."""

import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from meshes import quad_sphere
from rich.console import Console

import balloon_warp
from balloon_warp.cli.progress import FrameProgress
from balloon_warp.mesh.obj import write_obj


def read_all(terminal: int) -> str:
    """What was written to a pseudo-terminal until its other end closed."""
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


def test_a_run_on_a_terminal_shows_frames_a_second(tmp_path: Path):
    """On standard error; what is printed in the end is the same as in a pipe."""
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
    """How far it is, how fast, and how long it will take, once half a minute has gone."""
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
    assert lines[0] == "squirrel: frame 290 of 1,200, 9.67 frames/s, 94 s left"
    assert len(lines) == 4  # of two minutes
    assert log.getvalue().isascii()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere names are no bytes")
def test_names_and_logs_that_are_not_utf8_cost_no_work(tmp_path: Path):
    """A mesh with a Latin-1 name is simulated under a name that USD takes, and said in a log of any encoding."""
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
    assert done.stderr == b"error: ball.usdc: its name or its folder's is not UTF-8; expected one that is, by -o\n"

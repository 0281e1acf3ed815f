"""Kernels that are compiled in the background of the page, so that no interaction waits for them."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

PAGE = """
import sys, time
import numpy as np
import warp as wp
from browsing import tethered
from balloon_warp.viewer.ahead import Ahead
from balloon_warp.viewer.playground import Playground

wp.config.optimization_level = 0
playground, ahead = Playground(tethered(), "cpu"), Ahead()
playground.step()
ahead.begin(playground.start, "cpu")
print("process", ahead._process and ahead._process.pid, flush=True)
"""
"""what the page does first, with kernels that stay as they are written: it is about which are compiled"""
PLAYED = (
    PAGE
    + """
while ahead.busy:
    time.sleep(0.05)
from pathlib import Path
kernels = lambda: {path for path in Path(sys.argv[1]).rglob("*.o")}
before = kernels()
playground.throw(playground.points.mean(axis=0) + [0.0, 2.0, 0.0], np.zeros(3), 0.2, 1.0)
playground.step()
playground.grab("hand", 5, playground.points[5] + [0.0, 0.2, 0.0])
playground.step()
print("compiled", sorted(map(str, kernels() - before)))
ahead.end()
"""
)


def page(folder: Path, script: str) -> subprocess.Popen:
    """Start a process with a kernel cache of its own, in a folder."""
    found = {**os.environ, "WARP_CACHE_PATH": str(folder), "PYTHONPATH": str(Path(__file__).parents[2])}
    command = [sys.executable, "-c", script, str(folder)]
    return subprocess.Popen(command, env=found, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def is_there(process: int) -> bool:
    """Return whether a process lives: one that ended and waits to be noticed does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_a_first_touch_compiles_nothing(tmp_path):
    """A first interaction compiles nothing from an empty kernel cache; with a full one, no process starts."""
    pytest.importorskip("viser")
    said, wrong = page(tmp_path, PLAYED).communicate(timeout=600)
    assert "compiled []" in said, wrong
    assert list(tmp_path.rglob("balloon_warp_ahead_*"))
    said, wrong = page(tmp_path, PLAYED).communicate(timeout=600)
    assert "process None" in said, wrong


@pytest.mark.parametrize("killed", [False, True])
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="asks /proc")
def test_the_process_ends_with_the_page(killed: bool, tmp_path):
    """The process ends with the page, killed or not, and leaves no partial files."""
    pytest.importorskip("viser")
    process = page(tmp_path, PAGE + ("time.sleep(600)" if killed else "time.sleep(4.0); ahead.end()"))
    assert process.stdout
    ahead = int(process.stdout.readline().split()[1])
    assert is_there(ahead)
    time.sleep(3.0)  # it compiles
    if killed:
        process.kill()
    process.communicate(timeout=60)
    until = time.monotonic() + 30.0
    while is_there(ahead):
        assert time.monotonic() < until, "it lives on"
        time.sleep(0.05)
    assert list(tmp_path.rglob(f"*_p{ahead}_*")) == []

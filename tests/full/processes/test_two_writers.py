"""Two commands with one output: the second is refused at its start, unless the first was killed."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
from meshes import quad_sphere

from balloon_warp.mesh.obj import write_obj

LONG = "run ball.obj --frames 100000 --device cpu --checkpoint 0.2 -o out.usdc"
BATCH = "batch ball.obj --frames 100000 --device cpu --worlds 2 -o out"


def start(folder: Path, words: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "balloon_warp", *words.split()]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, cwd=folder, stdout=pipe, stderr=pipe, text=True)


@pytest.mark.parametrize(("long", "held"), [(LONG, "."), (BATCH, "out")], ids=["a run", "a batch"])
def test_the_second_is_refused_by_name_of_the_first(long: str, held: str, tmp_path: Path) -> None:
    write_obj(tmp_path / "ball.obj", quad_sphere(4))
    output, short = long.split()[-1], long.replace("100000", "1")
    first = start(tmp_path, long)
    try:
        for _ in range(1000):
            if len([*(tmp_path / held).glob(".balloon-warp-*.lock")]) > 1:  # its own, and those of files that it began
                break
            time.sleep(0.1)
        second = start(tmp_path, short)
        error = second.communicate(timeout=300)[1].splitlines()[-1]
        assert second.returncode == 2
        assert error.startswith(f"error: {output}: process {first.pid} on ")
        assert long[:40] in error
        assert first.poll() is None
    finally:
        first.kill()
        first.communicate()
    again = start(tmp_path, short)
    assert again.communicate(timeout=300) is not None
    assert again.returncode == 0
    assert not [*tmp_path.rglob(".balloon-warp-*")]

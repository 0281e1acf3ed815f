"""Standard streams that are closed, full, or that nobody reads."""

import subprocess
import sys
from pathlib import Path

import pytest
from meshes import cube

from balloon_warp.mesh.obj import write_obj

RUN, BATCH = "run box.obj --frames 1 --device cpu -o", "batch box.obj --worlds 2 --frames 1 --device cpu -o"
FULL = "error: standard output: cannot be written: No space left on device"


def shell(folder: Path, words: str) -> subprocess.CompletedProcess[str]:
    """Run a command with redirections, as a shell takes them."""
    write_obj(folder / "box.obj", cube())
    line = f"'{sys.executable}' -m balloon_warp {words}"
    return subprocess.run(["bash", "-c", line], cwd=folder, capture_output=True, text=True, timeout=300)


@pytest.mark.parametrize(
    ("words", "written"),
    [
        pytest.param(f"{RUN} out.usdc 2>&-", "out.usdc", id="no standard error"),
        pytest.param(f"{RUN} out.usdc <&- >&- 2>&-", "out.usdc", id="no stream at all"),
        pytest.param(f"{RUN} out.usdc 2> /dev/full", "out.usdc", id="standard error is full"),
        pytest.param(f"{RUN} out.usdc 2> >(true)", "out.usdc", id="nobody reads standard error"),
        pytest.param(f"{BATCH} out 2>&-", "out/manifest.json", id="a batch without standard error"),
    ],
)
def test_a_file_is_written_without_standard_error(words: str, written: str, tmp_path: Path) -> None:
    done = shell(tmp_path, words)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / written).stat().st_size > 100


@pytest.mark.parametrize("unbuffered", ["", "1"], ids=["buffered", "unbuffered"])
@pytest.mark.parametrize(
    "words", [f"{RUN} out.usdc --json", "inspect box.obj", "scenes squirrel_tether", "--version", "run --help"]
)
def test_standard_output_that_is_full_is_told(words: str, unbuffered: str, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("PYTHONUNBUFFERED", unbuffered)
    done = shell(tmp_path, f"{words} > /dev/full")
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == FULL
    assert "Traceback" not in done.stderr


def test_a_reader_that_has_enough_is_no_mistake(tmp_path: Path) -> None:
    done = shell(tmp_path, "scenes squirrel_tether | head -n 1")
    assert (done.returncode, done.stderr, done.stdout.count("\n")) == (0, "", 1)

"""Processes of the system: forked children, several at once, streams that are closed, and two writers."""

import os
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest
from meshes import cube, quad_sphere

from balloon_warp.benchmarks.cases import Case
from balloon_warp.benchmarks.scaling import Share, measure_scaling
from balloon_warp.mesh.obj import write_obj

SECONDS = 240
"""Time after which a child counts as hanging"""
BEFORE = """
    import multiprocessing, os, sys
    import balloon_warp as bw
    from meshes import quad_sphere
    from balloon_warp.scene import Balloon, Scene

    def pressed(pressure, frames=2):
        inflation = {"kind": "pressure", "pressure": pressure}
        return Scene(balloon=[Balloon(mesh=quad_sphere(2), inflation=inflation)], frames=frames)

    def height(pressure):
        simulator = bw.Simulator(pressed(pressure), device="cpu")
        *_, last = simulator.run()
        return float(last.points[0][:, 1].max())
"""
CHILDREN = {
    "a pool, while a kernel compiles": """
        os.environ["WARP_CACHE_PATH"] = sys.argv[1]  # which has no kernels: Warp is not there yet
        bw.Simulator(pressed(1.0), device="cpu")
        with multiprocessing.get_context("fork").Pool(2) as pool:
            heights = pool.map(height, [1.0, 2.0])
        assert heights == [height(1.0), height(2.0)]
    """,
    "a simulator of its parent": """
        simulator = bw.Simulator(pressed(1.0), device="cpu", world_count=32)
        simulator.step()
        child = os.fork()
        if not child:
            simulator.step()
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
    """,
    "a batch after a batch": """
        values = {"balloon.mass": [1.0, 2.0]}
        bw.run_batch(pressed(1.0), sys.argv[1] + "/parent", 2, values, device="cpu")
        child = os.fork()
        if not child:
            bw.run_batch(pressed(1.0), sys.argv[1] + "/child", 2, values, device="cpu")
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
    """,
    "environments": """
        import gymnasium, balloon_warp.learn
        name = "BalloonWarp/Altitude-v0"
        environments = gymnasium.vector.AsyncVectorEnv([lambda: gymnasium.make(name)] * 2, context="fork")
        environments.reset(seed=1)
        environments.step(environments.action_space.sample())
        environments.close()
    """,
}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks here")
@pytest.mark.parametrize("children", CHILDREN)
def test_forked_children_simulate(children: str, tmp_path: Path):
    program = textwrap.dedent(BEFORE) + textwrap.dedent(CHILDREN[children])
    path = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-c", program, str(tmp_path)]
    subprocess.run(command, check=True, timeout=SECONDS, env={**os.environ, "PYTHONPATH": path})


def test_two_processes_simulate_a_share_each():
    share, began = Share("cpu", Case("8 balloons", "lanes", 8, cells=3), frames=5), time.perf_counter()
    (result,) = measure_scaling(share, [2])
    work = 2 * 8 * 56 * 32 * share.frames
    assert (result.case, result.worlds, result.particles) == ("8 balloons x 2", 16, 56)
    assert result.ratio == pytest.approx(1.0)  # the others are compared with the first count
    assert 0.0 < work / result.rate < time.perf_counter() - began


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


LONG = "run ball.obj --frames 100000 --device cpu --checkpoint 0.2 -o out.usdc"
LONG_BATCH = "batch ball.obj --frames 100000 --device cpu --worlds 2 -o out"


def start(folder: Path, words: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "balloon_warp", *words.split()]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, cwd=folder, stdout=pipe, stderr=pipe, text=True)


@pytest.mark.parametrize(("long", "held"), [(LONG, "."), (LONG_BATCH, "out")], ids=["a run", "a batch"])
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

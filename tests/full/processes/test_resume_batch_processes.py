"""Batches and gradients by other processes, stopped ones, too: the same results, whatever their environment."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from batches import NAMES, address_of, contents, press_ctrl_c_once, start_workers
from meshes import quad_sphere
from pxr import Sdf, Usd
from small_batch import struck

from balloon_warp import Balloon, BlowUpError, Cluster, Inflation, InputError, Scene, Trajectories, gradient, run_batch
from balloon_warp.batch.task import STAGE_NAME
from balloon_warp.farm import cluster as shares
from balloon_warp.mesh.obj import write_obj
from balloon_warp.scene import load_scene

LONG = 200
"""frames of a batch that is ended while it simulates"""
WORLDS = 8


@pytest.fixture(scope="module")
def ball(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("ball")
    write_obj(folder / "ball.obj", quad_sphere(6))
    return folder


@pytest.fixture(scope="module")
def whole(ball: Path) -> dict[str, bytes]:
    """Return the files of an uninterrupted batch."""
    go_on(ball, ball / "whole", resume=False)
    return contents(ball / "whole")


def go_on(ball: Path, folder: Path, address: str | None = None, **options: Any) -> list[str]:
    """Simulate the batch in this process, or from here on a cluster, and return its message of where it begins."""
    notes: list[str] = []
    scene, vary = load_scene(str(ball / "ball.obj"), [("frames", LONG)]), {"gravity": np.linspace(1, 9, WORLDS)}
    how = {"export": range(WORLDS), "device": "cpu", "schedule": "lanes", "resume": True, **options}
    cluster = Cluster(address) if address else None
    run_batch(scene, folder, WORLDS, vary, cluster=cluster, on_note=notes.append, **how)
    return notes


def end(ball: Path, folder: Path, number: int, *words: str) -> tuple[int, str]:
    """Start the batch as a process, signal it once it has saved something, and return its status and messages."""
    fine = "from balloon_warp.farm import cluster; cluster.GRAIN['cpu'] = cluster.Grain(1, 1); "
    fine += "from balloon_warp.cli import main; main()"
    command = [sys.executable, "-c", fine, "batch", str(ball / "ball.obj"), "-o", str(folder), *words]
    varied = f"--worlds {WORLDS} --vary gravity=1:9 --grid --export all --schedule lanes --set frames={LONG}"
    command, pipe = [*command, *varied.split(), "--checkpoint", "0.01"], subprocess.PIPE
    process = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env={**os.environ, "NO_COLOR": "1"})
    try:
        while process.poll() is None and not list(folder.glob("partial/rows_*")):
            time.sleep(0.05)
        process.send_signal(number)
        said = process.communicate(timeout=300)[1]
    finally:
        process.kill()
    first, _, rest = said.partition("\n")
    assert first.startswith("note: ball.obj inflates above a floor. ")
    return process.returncode, rest


def test_a_killed_process_is_gone_on_from(ball: Path, whole: dict[str, bytes], tmp_path):
    assert end(ball, tmp_path / "out", signal.SIGKILL, "--device", "cpu") == (-signal.SIGKILL, "")
    assert contents(tmp_path / "out") == {}
    notes = go_on(ball, tmp_path / "out")
    assert re.fullmatch(r"resuming after frame \d+, from .*out/partial", *notes)
    assert contents(tmp_path / "out") == whole
    assert not (tmp_path / "out" / "partial").exists()


def test_a_process_that_is_told_to_end_finishes_its_frame_and_saves_it(ball: Path, whole: dict[str, bytes], tmp_path):
    status, said = end(ball, tmp_path / "out", signal.SIGTERM, "--device", "cpu")
    assert status == 128 + signal.SIGTERM
    stopped = r"error: ball was interrupted after frame (\d+) of 200"
    advice = r".*out/partial/frames\.usda plays the frames so far, and --resume continues from them"
    assert (found := re.fullmatch(rf"{stopped}; {advice}\n", said)), said
    assert contents(tmp_path / "out") == {}
    assert go_on(ball, tmp_path / "out") == [f"resuming after frame {found[1]}, from {tmp_path / 'out' / 'partial'}"]
    assert contents(tmp_path / "out") == whole


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Yield the address of a scheduler with two workers."""
    with start_workers(2) as workers:
        yield str(workers.scheduler_address)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_cluster_goes_on_without_the_shares_that_are_done(ball, whole, address, tmp_path, monkeypatch, number):
    monkeypatch.setitem(shares.GRAIN, "cpu", shares.Grain(1, 1))
    out = tmp_path / "out"
    if number == signal.SIGKILL:
        end(ball, out, number, "--cluster", address, "--device", "cpu")
    else:
        press = press_ctrl_c_once(lambda frame: frame > LONG / 2)  # at most two shares are between start and end
        plays = r"partial/frames\.usda plays the frames so far, and --resume continues from them$"
        with pytest.raises(KeyboardInterrupt, match=plays):
            go_on(ball, out, address, on_frame=press, checkpoint_seconds=0.0)
    assert contents(out) == {}
    stages = out / "partial/frames.usda", ball / "whole" / STAGE_NAME
    together, expected = (Usd.Stage.Open(str(path)) for path in stages)
    assert together.GetEndTimeCode() == LONG
    done = np.concatenate([np.load(path)["worlds"] for path in out.glob("partial/rows_*")])
    for world in range(WORLDS):
        path = Sdf.Path(f"/World/World_{world}/ball.points")
        found, there = (stage.GetAttributeAtPath(path) for stage in (together, expected))
        assert there.GetNumTimeSamples() == LONG + 1
        assert found.GetNumTimeSamples() == (LONG + 1 if world in done else 0)
        if world in done:
            np.testing.assert_array_equal(found.Get(LONG), there.Get(LONG))
    notes = go_on(ball, out, address)
    assert re.fullmatch(r"resuming with [1-7] of 8 shares done, from .*out/partial", *notes)
    written = contents(out)
    stages = [Sdf.Layer.OpenAsAnonymous(str(folder / STAGE_NAME)).ExportToString() for folder in (out, ball / "whole")]
    assert stages[0] == stages[1]  # sample by sample: the shares came in another order
    assert {name: written[name] for name in NAMES[:4]} == {name: whole[name] for name in NAMES[:4]}
    assert not (out / "partial").exists()


SCENE = Scene(
    balloon=[Balloon(mesh=quad_sphere(3, 0.2), mass=0.2, inflation=Inflation(pressure=40.0))], frames=3, substeps=8
)
STIFFNESS, MASS = "balloon.stiffness.structural", "balloon.mass"
DERIVED_WORLDS = 5
VARY = {STIFFNESS: np.linspace(40.0, 60.0, DERIVED_WORLDS), MASS: np.linspace(0.1, 0.3, DERIVED_WORLDS)}
HEIGHTS = np.linspace(0.0, 0.4, DERIVED_WORLDS)
"""Targets of all worlds [m], of which a worker has some"""


def far(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
    """Return how far particles end from the height of the world's target, squared, and the derivatives."""
    points = moved.points[0].reshape(len(moved.worlds), *moved.points[0].shape[-3:])
    off = points[:, -1, :, 1] - HEIGHTS[moved.worlds, None]
    slopes = np.zeros(points.shape)
    slopes[:, -1, :, 1] = 2.0 * off
    return (off**2).sum(axis=1), {"points": [slopes.reshape(moved.points[0].shape)]}


@pytest.fixture(scope="module")
def cluster() -> Iterator[Cluster]:
    """Two workers on this machine."""
    pytest.importorskip("distributed", reason="needs the extra `cluster`")
    with start_workers(2) as workers:
        yield Cluster(address=str(workers.scheduler_address))


@pytest.mark.parametrize("world_count", [1, DERIVED_WORLDS])
def test_workers_give_the_bits_of_one_process(cluster: Cluster, world_count: int) -> None:
    """Two workers take three worlds and two, with the targets of their own; of a single world one takes all."""
    vary = {path: values[:world_count] for path, values in VARY.items()}
    asked: dict[str, Any] = {"of": [STIFFNESS, MASS], "loss": far, "world_count": world_count, "device": "cpu"}
    alone = gradient(SCENE, **asked, vary=vary)
    frames: list[int] = []
    together = gradient(SCENE, **asked, vary=vary, cluster=cluster, on_frame=frames.append)
    np.testing.assert_array_equal(together.loss, alone.loss)
    for path, values in alone.gradients.items():
        np.testing.assert_array_equal(together.gradients[path], values)
        assert values.all()
    for name in ("by_points", "by_velocities"):
        np.testing.assert_array_equal(getattr(together, name), getattr(alone, name))
    for name in ("points", "velocities", "pressures", "gas_amounts", "sphere_positions", "worlds"):
        np.testing.assert_array_equal(getattr(together.trajectories, name), getattr(alone.trajectories, name))
    assert frames == sorted(frames)
    assert frames[-1] == 2 * SCENE.frames + 1


def test_a_world_that_blows_up_on_a_worker_has_its_own_number(cluster: Cluster) -> None:
    vary = {"balloon.inflation.pressure": [40.0, 40.0, 40.0, 1e11]}
    with pytest.raises(BlowUpError) as alone:
        gradient(SCENE, of=[MASS], loss=far, world_count=4, vary=vary, device="cpu")
    with pytest.raises(BlowUpError, match=re.escape(str(alone.value))):
        gradient(SCENE, of=[MASS], loss=far, world_count=4, vary=vary, device="cpu", cluster=cluster)
    assert "world 3" in str(alone.value)


def test_a_loss_that_cannot_be_sent_is_refused() -> None:
    pytest.importorskip("distributed", reason="needs the extra `cluster`")
    lock = threading.Lock()

    def locked(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
        with lock:
            return far(moved)

    with pytest.raises(InputError, match=r"^loss: cannot be sent to other processes \(workers 2\): "):
        gradient(SCENE, of=[MASS], loss=locked, world_count=2, cluster=Cluster(workers=2))


WRITE = """
import sys
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.studio.animate import animate
from balloon_warp.scene import load_scene
from balloon_warp.batch.batch import run_batch

if __name__ == "__main__":
    quiet_warp()
    scene, output = load_scene(sys.argv[1], [("frames", 3)]), sys.argv[2]
    animate(scene, output + "/explicit.usdc", device="cpu")
    animate(load_scene(sys.argv[1], [("frames", 3), ("solver", "projective")]), output + "/implicit.usda", device="cpu")
    vary = {"gravity": [9.0, 9.1, 9.2], "balloon.inflation.k_normal": [0.1, 0.2, 0.3]}
    run_batch(scene, output + "/batch", 3, vary, export=[1, 2], device="cpu")
"""
SCENE_FILE = """
[[balloon]]
mesh = "bälle.obj"
[balloon.inflation]
k_normal = 0.2
[[sphere]]
position = [0.0, 1.5, 0.0]
radius = 0.3
[[string]]
anchor = [0.0, -1.5, 0.0]
[ground]
height = -1.2
"""
ENVIRONMENTS = (
    {"PYTHONHASHSEED": "0", "LC_ALL": "C", "TZ": "UTC", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    {"PYTHONHASHSEED": "4294967295", "LC_ALL": "C.UTF-8", "TZ": "Asia/Kolkata", "PYTHONUTF8": "1"},
)


def test_the_environment_of_a_process_is_not_in_its_outputs(tmp_path: Path):
    """Outputs do not depend on the hash seed, locale, time zone, number of threads, or working directory."""
    (tmp_path / "write.py").write_text(WRITE, encoding="utf-8")
    (tmp_path / "scene.toml").write_text(SCENE_FILE, encoding="utf-8")
    write_obj(tmp_path / "bälle.obj", quad_sphere(3))
    written = []
    for number, scene in enumerate(("../scene.toml", str(tmp_path / "scene.toml"))):
        folder = tmp_path / f"from {number}"
        folder.mkdir()
        environment = {name: value for name, value in os.environ.items() if name not in ENVIRONMENTS[0]}
        command = [sys.executable, "../write.py", scene, "." if number else str(folder)]
        subprocess.run(command, env=environment | ENVIRONMENTS[number], cwd=folder, check=True)
        files = [path for path in folder.rglob("*") if path.is_file() and path.name != "manifest.json"]
        written.append({str(path.relative_to(folder)): path.read_bytes() for path in files})
    assert len(written[0]) == 7
    assert written[0] == written[1]


@pytest.mark.parametrize("count", [1, 3])
def test_the_number_of_workers_is_not_in_the_table(count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Each of the workers takes shares of two worlds or three, with the projective solver, too."""
    pytest.importorskip("distributed", reason="needs the extra `cluster`")
    monkeypatch.setitem(shares.GRAIN, "cpu", shares.Grain(1, 1))  # small batches are cut, too
    monkeypatch.setattr(shares, "SHARES", 8)
    vary = {"gravity": [9.0 + 0.1 * world for world in range(19)]}
    with start_workers(count) as workers:  # those of a scheduler serve one batch after the other
        for solver in ("symplectic_euler", "projective"):
            tables = []
            for cluster in (None, Cluster(address=address_of(workers))):
                run_batch(struck(frames=3, solver=solver), tmp_path, 19, vary, device="cpu", cluster=cluster)
                tables.append([(tmp_path / name).read_bytes() for name in ("table.npz", "table.csv")])
            assert tables[0] == tables[1]

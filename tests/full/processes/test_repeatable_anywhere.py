"""Independence of outputs from the process, its environment, and the number of workers."""

import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from clusters import address_of, start_workers
from meshes import quad_sphere
from small_batch import struck

from balloon_warp import Cluster, run_batch
from balloon_warp.farm import cluster as shares
from balloon_warp.mesh.obj import write_obj

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
SCENE = """
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
SCHEDULES = ("gather", "octets", "lanes", "block", "projective")
ENVIRONMENTS = (
    {"PYTHONHASHSEED": "0", "LC_ALL": "C", "TZ": "UTC", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    {"PYTHONHASHSEED": "4294967295", "LC_ALL": "C.UTF-8", "TZ": "Asia/Kolkata", "PYTHONUTF8": "1"},
)


def test_the_environment_of_a_process_is_not_in_its_outputs(tmp_path: Path):
    """Outputs do not depend on the hash seed, locale, time zone, number of threads, or working directory."""
    (tmp_path / "write.py").write_text(WRITE, encoding="utf-8")
    (tmp_path / "scene.toml").write_text(SCENE, encoding="utf-8")
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


@cache
def tables_alone(folder: Path) -> dict[str, list[bytes]]:
    """Return the tables of each schedule, by this process."""
    return {schedule: tables(schedule, folder) for schedule in SCHEDULES}


def tables(schedule: str, folder: Path, cluster: Cluster | None = None) -> list[bytes]:
    scene = struck(frames=3, solver="projective" if schedule == "projective" else "symplectic_euler")
    vary = {"gravity": [9.0 + 0.1 * world for world in range(19)]}
    run_batch(scene, folder, 19, vary, schedule=schedule, device="cpu", cluster=cluster)
    return [(folder / name).read_bytes() for name in ("table.npz", "table.csv")]


@pytest.mark.parametrize("count", [1, pytest.param(2, marks=pytest.mark.nightly), 3])
def test_the_number_of_workers_is_not_in_the_table(count: int, tmp_path_factory, monkeypatch):
    pytest.importorskip("distributed", reason="needs the extra `cluster`")
    monkeypatch.setitem(shares.GRAIN, "cpu", shares.Grain(1, 1))  # small batches are cut, too
    monkeypatch.setattr(shares, "SHARES", 4)
    alone = tables_alone(tmp_path_factory.getbasetemp() / "alone")
    with start_workers(count) as workers:  # those of a scheduler serve one batch after the other
        for schedule in SCHEDULES:
            folder = tmp_path_factory.mktemp(schedule)
            assert tables(schedule, folder, Cluster(address=address_of(workers))) == alone[schedule], schedule

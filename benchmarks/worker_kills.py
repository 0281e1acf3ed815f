"""Kills workers of a cluster at random moments, and looks at whether the batch is what one process writes.

    python -m balloon_warp.benchmarks.worker_kills --count 10

needs the extra `cluster`.
"""

import argparse
import functools
import os
import random
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from pxr import Sdf

from balloon_warp.batch.batch import run_batch
from balloon_warp.farm.cluster import Cluster
from balloon_warp.mesh.topology import quad_sphere
from balloon_warp.scene import Balloon, Inflation, Scene, String
from balloon_warp.system.warp_setup import quiet_warp

FRAMES, WORLDS, EXPORT = 30, 128, [0, 127]
"""of 98 particles: four shares"""


def kill_workers(count: int, folder: Path, seed: int = 0) -> Counter[str]:
    """Simulate a batch on two workers, so many times, and kill one of them in the middle of each.

    Args:
        count: how many batches, and workers killed.
        folder: where they are written.
        seed: of the moments.

    Returns:
        how many batches were the "same" as of one process, or "damaged".
    """
    _simulate(folder / "alone")
    outcomes, choices = Counter[str](), random.Random(seed)
    for number in range(count):
        processes = folder / f"processes_{number}"
        processes.mkdir()
        cluster = Cluster(workers=2, prepare=functools.partial(_prepare, str(processes)))
        killer = _Killer(processes, choices.uniform(0.0, 0.8 * FRAMES), choices.random())
        _simulate(folder / str(number), cluster, killer)
        assert killer.done
        outcomes["same" if _are_same(folder / str(number), folder / "alone") else "damaged"] += 1
    return outcomes


class _Killer:
    """Kills one of the noted processes when the average world is at a frame."""

    def __init__(self, processes: Path, moment: float, which: float):
        self.processes, self.moment, self.which, self.done = processes, moment, which, False

    def __call__(self, frame: int) -> None:
        if frame >= self.moment and not self.done:
            noted = sorted(self.processes.iterdir())
            os.kill(int(noted[int(self.which * len(noted))].name), signal.SIGKILL)
            self.done = True


def _prepare(folder: str) -> None:
    """Note the worker's process."""
    quiet_warp()
    (Path(folder) / str(os.getpid())).touch()


def _simulate(
    folder: Path, cluster: Cluster | None = None, on_frame: Callable[[int], None] = lambda number: None
) -> None:
    scene = Scene(
        frames=FRAMES,
        substeps=100,
        normals="cached",
        balloon=[Balloon(mesh=quad_sphere(4, 1.0), inflation=Inflation(k_normal=0.2))],
        string=[String(anchor=(0.0, -2.0, 0.0))],
    )
    vary = {"gravity": [0.5 * world for world in range(WORLDS)]}
    device = None if cluster else "cpu"
    run_batch(scene, folder, WORLDS, vary, export=EXPORT, device=device, cluster=cluster, on_frame=on_frame)


def _are_same(folder: Path, other: Path) -> bool:
    """Return whether the tables agree byte by byte, and the stages sample by sample, in any order."""
    tables = [[(place / name).read_bytes() for name in ("table.csv", "table.npz")] for place in (folder, other)]
    stages = [Sdf.Layer.FindOrOpen(str(place / "worlds.usdc")).ExportToString() for place in (folder, other)]
    return tables[0] == tables[1] and stages[0] == stages[1]


def main() -> None:
    """Print the number of batches by outcome; status 1 where one is damaged."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=10, help="workers to kill")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    arguments = parser.parse_args()
    quiet_warp()
    with tempfile.TemporaryDirectory() as folder:
        outcomes = kill_workers(arguments.count, Path(folder), arguments.seed)
    same, damaged = outcomes["same"], outcomes["damaged"]
    print(f"workers: {outcomes.total()} killed, {same} batches the same as of one process; {damaged} damaged")
    sys.exit(1 if damaged else 0)


if __name__ == "__main__":
    main()

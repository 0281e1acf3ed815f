"""Scaling of a batch, an environment or a gradient over GPUs, with all that it takes from start to end.

    python -m balloon_warp.benchmarks.strong_scaling batch --gpus 1,2,4
    python -m balloon_warp.benchmarks.strong_scaling environment --gpus 1,2,4
    python -m balloon_warp.benchmarks.strong_scaling gradient --gpus 1,2,4

needs the extras `data` and `envs`. `--workers 1,2` takes processes of the CPU, and fewer worlds. `batch` measures the
command, and takes `--worlds` and `--frames`.
"""

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from balloon_warp.benchmarks.cases import Case
from balloon_warp.farm.cluster import Cluster
from balloon_warp.lab.gradients import losses
from balloon_warp.lab.gradients.gradient import gradient
from balloon_warp.learn import BalloonVectorEnv, make_vec
from balloon_warp.learn.tasks import Altitude
from balloon_warp.system.warp_setup import quiet_warp

VARIED, DERIVED = "balloon.helium", "balloon.mass"
REPEATS, LEAD_SECONDS = 3, 0.5
"""of steps of an environment: the best one counts; and the time until all processes begin to step together [s]"""


@dataclass(frozen=True)
class Size:
    """Size of each measurement."""

    worlds: int
    frames: int
    env_worlds: int
    """of each GPU: this one is weak scaling, as policies learn"""
    env_steps: int
    derived_worlds: int
    derived_frames: int


GPU_SIZE = Size(65_536, 300, 4096, 100, 1024, 10)
CPU_SIZE = Size(256, 10, 16, 10, 8, 4)


def cluster_of(kind: str, count: int) -> Cluster:
    """Return so many GPUs, or processes of the CPU."""
    return Cluster(gpus=count) if kind == "gpus" else Cluster(workers=count)


def batch_seconds(worlds: int, frames: int, kind: str, count: int, folder: Path) -> tuple[float, float, str]:
    """Return seconds until the command `balloon-warp batch` simulates, and until it ends; and a hash of its tables."""
    command = f"batch squirrel_tether --worlds {worlds} --frames {frames} --vary {VARIED}=8:16 --grid --table parquet"
    words = [sys.executable, "-m", "balloon_warp", *command.split(), f"--{kind}", str(count), "-o", str(folder)]
    began = time.perf_counter()
    told = subprocess.run([*words, "--json"], check=True, capture_output=True, text=True).stdout
    together = time.perf_counter() - began
    digest = hashlib.sha256()
    for name in ("table.parquet", "table.npz"):
        with open(folder / name, "rb") as file:
            digest.update(hashlib.file_digest(file, "sha256").digest())
    return together - json.loads(told)["wall_seconds"], together, digest.hexdigest()[:12]


def step_with_policy(env: BalloonVectorEnv, steps: int, begin: float) -> tuple[float, float]:
    """Step an environment with a policy on its device from a moment on; return when that began and ended.

    The policy is a network of torch, where it is installed, or else the task's own.
    """
    try:
        import torch
    except ImportError:
        policy = env.task.policy
    else:
        sizes = (env.task.observations, 64, 64, env.task.actions)
        layers = [each for pair in pairwise(sizes) for each in (torch.nn.Linear(*pair), torch.nn.Tanh())]
        device = "cuda" if torch.cuda.is_available() else "cpu"
        network = torch.nn.Sequential(*layers).to(device)

        def policy(observations: Any) -> Any:
            with torch.no_grad():
                return network(torch.as_tensor(observations, device=device))

    observations, _ = env.reset(seed=0)
    for _ in range(3):
        observations, *_ = env.step(policy(observations))
    _wait_for(env)
    while begin - time.monotonic() > 0.0:
        time.sleep(1.0e-4)
    began = time.monotonic()
    for _ in range(steps):
        observations, *_ = env.step(policy(observations))
    _wait_for(env)
    return began, time.monotonic()


def _wait_for(env: BalloonVectorEnv) -> None:
    wp.synchronize_device(env.simulator.model.device)


def env_rate(size: Size, count: int, places: dict[str, int], output: str) -> float:
    """Return environment steps a second of `Altitude` with a policy in each process."""
    options: dict[str, Any] = {"autoreset_mode": "SameStep", "output": output}
    env = make_vec(Altitude(rate=96), count * size.env_worlds, **places, **options)
    env.on_each(step_with_policy, 2, 0.0)
    best = np.inf
    for _ in range(REPEATS):
        spans = env.on_each(step_with_policy, size.env_steps, time.monotonic() + LEAD_SECONDS)
        best = min(best, max(end for _, end in spans) - min(begin for begin, _ in spans))
    env.close()
    return count * size.env_worlds * size.env_steps / best


def gradient_of(size: Size, cluster: Cluster) -> tuple[float, float]:
    """Return seconds of a batch's gradient, and its sum over worlds, by a mass that they share."""
    scene = Case("", "auto", 1, gas=True).scene().model_copy(update={"frames": size.derived_frames})
    began = time.perf_counter()
    found = gradient(scene, of=[DERIVED], loss=losses.height(2.0), world_count=size.derived_worlds, cluster=cluster)
    return time.perf_counter() - began, float(found.gradients[DERIVED].sum())


def print_batch(counts: Sequence[int], kind: str, size: Size) -> None:
    """Print a row for each number of GPUs or processes: seconds of the parts of a batch, and a hash of its tables."""
    print(f"{size.worlds:,} worlds of squirrel_tether, {size.frames} frames, tables written: seconds")
    print(f"| {kind} | start | simulate and write | times one | together | times one | tables |")
    print("|---|---|---|---|---|---|---|")
    alone: tuple[float, float] | None = None
    with tempfile.TemporaryDirectory() as folder:
        batch_seconds(size.worlds, 1, kind, 1, Path(folder))  # compiles the kernels for so many worlds
    for count in counts:
        with tempfile.TemporaryDirectory() as folder:
            start, together, digest = batch_seconds(size.worlds, size.frames, kind, count, Path(folder))
        parts = together - start, together
        alone = alone or parts
        cells = " | ".join(f"{part:.1f} | {one / part:.2f}" for one, part in zip(alone, parts, strict=True))
        print(f"| {count} | {start:.1f} | {cells} | {digest} |", flush=True)


def print_environment(counts: Sequence[int], kind: str, size: Size) -> None:
    """Print a row for each number of GPUs or processes: steps a second, of an environment's worlds on each."""
    print(f"Altitude, {size.env_worlds:,} worlds each, a policy on each: steps a second")
    outputs = ("numpy", "torch") if find_spec("torch") else ("numpy",)
    print(f"| {kind} | {' | of linear | '.join(outputs)} | of linear |\n|---|{'---|---|' * len(outputs)}")
    firsts: dict[str, float] = {}
    for count in counts:
        cells = []
        for output in outputs:
            rate = env_rate(size, count, {kind: count}, output)
            firsts.setdefault(output, rate / count)
            cells += [f"{rate:.3g}", f"{rate / count / firsts[output]:.2f}"]
        print(f"| {count} | {' | '.join(cells)} |", flush=True)


def print_gradient(counts: Sequence[int], kind: str, size: Size) -> None:
    """Print a row for each number of GPUs or processes: seconds of a gradient, and its sum over worlds."""
    print(f"Gradient of {size.derived_worlds:,} worlds, {size.derived_frames} frames, by a mass that they share")
    print(f"| {kind} | seconds | times one | sum |\n|---|---|---|---|")
    first = 0.0
    gradient_of(replace(size, derived_frames=1), cluster_of(kind, 1))  # compiles
    for count in counts:
        seconds, total = gradient_of(size, cluster_of(kind, count))
        first = first or seconds
        print(f"| {count} | {seconds:.1f} | {first / seconds:.2f} | {total:.9g} |", flush=True)


WAYS = {"batch": print_batch, "environment": print_environment, "gradient": print_gradient}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=WAYS)
    among = parser.add_mutually_exclusive_group(required=True)
    among.add_argument("--gpus", metavar="1,2,4", help="numbers of GPUs")
    among.add_argument("--workers", metavar="1,2", help="numbers of processes of the CPU")
    parser.add_argument("--worlds", type=int, help="of a batch")
    parser.add_argument("--frames", type=int, help="of a batch")
    options = parser.parse_args()
    quiet_warp()
    kind, size = ("gpus", GPU_SIZE) if options.gpus else ("workers", CPU_SIZE)
    given = {"worlds": options.worlds, "frames": options.frames}
    size = replace(size, **{name: number for name, number in given.items() if number})
    counts = [int(word) for word in getattr(options, kind).split(",")]
    WAYS[options.what](counts, kind, size)


if __name__ == "__main__":
    main()

"""Cost of actions, observations, rewards and new starts beside the frames themselves.

Run it by python -m balloon_warp.benchmarks.environments [DEVICE] [WORLDS] [STEPS].
"""

import sys
import tempfile
from collections.abc import Callable
from copy import copy
from importlib.util import find_spec
from time import perf_counter
from typing import Any

import numpy as np
import warp as wp

from balloon_warp.batch.batch import run_batch
from balloon_warp.learn.tasks import Altitude, Inflate, Task
from balloon_warp.learn.vector_env import BalloonVectorEnv, Output
from balloon_warp.scene import load_scene
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.system.warp_threads import pick_device

REPEATS, BATCH_SECONDS = 5, 2.0
"""Number of turns, and simulated time of a batch, beside which its start does not count [s]"""
PATH = "balloon.inflation.pressure"
"""Overrides of `squirrel_tether`"""


def seconds_of(device: Any, count: int, *ways: Callable[[], Any]) -> list[float]:
    """Seconds of one of so many calls of each, which take turns: the best of a few."""
    best = [np.inf for _ in ways]
    for advance in ways:
        advance()
    for _ in range(REPEATS):
        for number, advance in enumerate(ways):
            wp.synchronize_device(device)
            begin = perf_counter()
            for _ in range(count):
                advance()
            wp.synchronize_device(device)
            best[number] = min(best[number], (perf_counter() - begin) / count)
    return best


def of_task(task: Task, device: Any, worlds: int, steps: int) -> None:
    """Environment steps a second, beside the bare frames of the same scene and of a batch."""
    bare = Simulator(task.scene(), str(device), worlds, laws=task.laws())
    outputs: list[Output] = ["numpy", "torch"] if find_spec("torch") else ["numpy"]
    ways = [
        _stepping(BalloonVectorEnv(copy(task), worlds, device=str(device), autoreset_mode="SameStep", output=output))
        for output in outputs
    ]
    steered = Simulator(task.scene(), str(device), worlds, laws=task.laws())
    copy(task).begin(steered)
    frame, frame_steered, *told = seconds_of(device, steps, bare.advance, steered.advance, *ways)
    print(f"{type(task).__name__}, {worlds} worlds, {bare.model.substeps} substeps of {bare.model.particle_count}")
    for output, step in zip(outputs, told, strict=True):
        shares = f"{frame_steered / step:.2f} of the frames of its scene with controls, {frame / step:.2f} without"
        print(f"  {output}: {worlds / step:.3g} steps a second, {shares}")
    _print_batch(task, device, worlds, steps, told[0])


def _stepping(env: BalloonVectorEnv) -> Callable[[], Any]:
    """Return a function that steps an environment by random actions, as arrays of its own kind."""
    observations, _ = env.reset(seed=0)
    actions: Any = np.random.default_rng(0).uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32)
    if not isinstance(observations, np.ndarray):
        import torch

        actions = torch.from_numpy(actions).to(observations.device)
    return lambda: env.step(actions)


def _print_batch(task: Task, device: Any, worlds: int, steps: int, step: float) -> None:
    """Measure a batch, which makes a table: its rate by the difference of two lengths."""
    seconds = []
    longer = max(3 * steps, int(BATCH_SECONDS / step))
    for frames in (1, 1 + longer):
        scene = task.scene().model_copy(update={"frames": frames})
        with tempfile.TemporaryDirectory() as folder:
            begin = perf_counter()
            run_batch(scene, folder, worlds, device=str(device), laws=task.laws())
            seconds.append(perf_counter() - begin)
    frame = (seconds[1] - seconds[0]) / longer
    print(f"  a batch: {worlds / frame:.3g} frames a second; the environment has {frame / step:.2f} of them")


def of_squirrels(device: Any, worlds: int, steps: int) -> None:
    """Set, step and observe, and begin 1% anew in each frame, over the step alone."""
    scene = load_scene("squirrel_tether")
    bare = Simulator(scene, str(device), worlds)
    steered = Simulator(scene, str(device), worlds)
    values = wp.zeros(worlds, dtype=float, device=device)
    values.fill_(float(np.ravel(steered.controls[PATH].numpy())[0]))
    steered.observations["centers"]

    def advance() -> None:
        steered.controls[PATH] = values
        steered.advance()

    mask = wp.array(np.arange(worlds) % 100 == 0, dtype=wp.int32, device=device)

    def restart() -> None:
        steered.reset(mask)
        advance()

    alone, both, anew = seconds_of(device, steps, bare.advance, advance, restart)
    print(
        f"squirrel_tether, {worlds} worlds: {1e3 * alone:.3g} ms a frame; set, step, observe {both / alone:.3f} of it"
    )
    print(f"  and 1% begun anew in each frame {anew / both:.3f} of that")


def main() -> None:
    quiet_warp()
    device = pick_device(sys.argv[1] if len(sys.argv) > 1 else None)
    worlds = int(sys.argv[2]) if len(sys.argv) > 2 else 64
    steps = int(sys.argv[3]) if len(sys.argv) > 3 else 10
    print(device)
    of_task(Altitude(rate=96), device, worlds, steps)
    of_task(Inflate(), device, worlds, steps)
    of_squirrels(device, worlds, steps)


if __name__ == "__main__":
    main()

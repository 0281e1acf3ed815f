"""A batch: many worlds of a scene that differ, simulated together; a table of all, and a stage of the chosen ones."""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.device import pick_device
from balloon_warp.errors import InputError
from balloon_warp.model import lay_out
from balloon_warp.model.memory import require_memory, world_bytes
from balloon_warp.outputs.background import WAITING, Background
from balloon_warp.scene import Scene
from balloon_warp.simulator import Simulator
from balloon_warp.sweep.groups import BatchVary, Group, plan_groups
from balloon_warp.sweep.output import BatchOutput
from balloon_warp.sweep.recorder import MEASURES, Recorder, picked_bytes, record_bytes


@dataclass(frozen=True)
class BatchSummary:
    """What was done, how much, and how fast."""

    output: str
    """the folder that was written"""
    table: list[str]
    stage: str | None
    """of the exported worlds"""
    scene: str
    device: str
    schedule: str
    worlds: int
    exported_worlds: int
    unhealthy_worlds: int
    """worlds that left the finite numbers; their rows stay at the last good frame"""
    particles: int
    """in all worlds"""
    springs: int
    """in all worlds"""
    frames: int
    substeps: int
    """in one frame"""
    wall_seconds: float
    particle_substeps_per_second: float

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def run_batch(
    scene: Scene,
    folder: str | Path,
    world_count: int,
    vary: BatchVary | None = None,
    *,
    export: Sequence[int] = (),
    name: str = "",
    device: str | None = None,
    schedule: str = "auto",
    on_frame: Callable[[int], None] = lambda number: None,
) -> BatchSummary:
    """Simulate worlds that differ; write `table.npz`, `table.csv` and, of the chosen worlds, `worlds.usdc`.

    Args:
        scene: what all worlds have in common.
        folder: where the files go; made if it is not there.
        world_count: how many worlds.
        vary: what differs: dotted paths as in overrides, and a value for each world, shape (world_count,).
        export: the worlds that go into the stage.
        name: what the summary calls the scene.
        device: a Warp device; the GPU where there is one, when missing.
        schedule: "scatter", "gather", "block", "lanes", or "auto" for the fastest.
        on_frame: told the number of each frame when it is simulated.

    Raises:
        InputError: the scene cannot be simulated, a varied value is wrong, the worlds do not fit into the memory, or
            the folder cannot be written; nothing is written then.
    """
    began = time.perf_counter()
    vary, folder, chosen = vary or {}, Path(folder), np.unique(np.asarray(export, dtype=np.int64))
    if len(chosen) and not 0 <= chosen[0] <= chosen[-1] < world_count:
        raise InputError(f"export: expected worlds 0 to {world_count - 1} (got {chosen[0]} to {chosen[-1]})")
    target = pick_device(device)
    groups = plan_groups(scene, world_count, vary)
    _require_memory(target, groups, chosen, scene)
    simulators = [Simulator.of_model(lay_out(group.plan, target), schedule) for group in groups]
    recorders = [
        Recorder(simulator, group.rows_of(chosen)) for simulator, group in zip(simulators, groups, strict=True)
    ]
    with BatchOutput(folder, scene, groups, chosen, vary) as output, Background() as writer:
        for number in range(scene.frames + 1):
            for simulator in simulators if number else ():
                simulator.advance()
            writer.submit(output.write, [recorder.read() for recorder in recorders])
            on_frame(number)
    seconds = time.perf_counter() - began
    particles = sum(simulator.model.particle_count * simulator.model.world_count for simulator in simulators)
    return BatchSummary(
        output=str(folder),
        table=[str(folder / "table.npz"), str(folder / "table.csv")],
        stage=str(folder / "worlds.usdc") if len(chosen) else None,
        scene=name,
        device=str(target),
        schedule=simulators[0].schedule.name,
        worlds=world_count,
        exported_worlds=len(chosen),
        unhealthy_worlds=world_count - output.healthy_count,
        particles=particles,
        springs=sum(simulator.model.spring_count * simulator.model.world_count for simulator in simulators),
        frames=scene.frames,
        substeps=groups[0].plan.substeps,
        wall_seconds=round(seconds, 3),
        particle_substeps_per_second=round(particles * groups[0].plan.substeps * scene.frames / seconds),
    )


def _require_memory(device: wp.Device, groups: list[Group], chosen: NDArray[np.integer], scene: Scene) -> None:
    """Before anything is allocated: the worlds on the device, the table and the frames under way on the host."""
    counts = [len(group.worlds) for group in groups]
    on_device, on_host = [], []
    for group in groups:
        picked = picked_bytes(group.plan) * len(group.rows_of(chosen)) // len(group.worlds)
        measures = len(MEASURES) + len(scene.sphere)
        on_device.append(world_bytes(group.plan) + record_bytes(group.plan) + picked)
        on_host.append(4 * (scene.frames + 1) * (measures + 1) + (WAITING + 2) * picked)
    host = wp.get_device("cpu")
    if device.is_cpu:
        on_host = [sum(both) for both in zip(on_device, on_host, strict=True)]
    else:
        require_memory(device, counts, on_device)
    require_memory(host, counts, on_host)

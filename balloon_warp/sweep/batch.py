"""A batch: many worlds of a scene that differ, simulated together; a table of all, and a stage of the chosen ones."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from balloon_warp.blow_ups import check_policy
from balloon_warp.device import pick_device
from balloon_warp.errors import InputError
from balloon_warp.model import lay_out
from balloon_warp.outputs.background import WAITING, Background
from balloon_warp.scene import Scene
from balloon_warp.simulator import Simulator
from balloon_warp.solvers.choose import settled_solver
from balloon_warp.sweep.cluster import Cluster
from balloon_warp.sweep.failures import Failures, report_failures, require_health, restart_failures
from balloon_warp.sweep.groups import BatchVary, plan_groups
from balloon_warp.sweep.manifest import MANIFEST_NAME, describe_batch, write_manifest
from balloon_warp.sweep.memory import require_batch_memory
from balloon_warp.sweep.output import STAGE_NAME, BatchOutput
from balloon_warp.sweep.recorder import Recorder
from balloon_warp.sweep.task import BatchTask, Outcome


@dataclass(frozen=True)
class BatchSummary:
    """What was done, how much, and how fast."""

    output: str
    """the folder that was written"""
    table: list[str]
    stage: str | None
    """of the exported worlds"""
    manifest: str
    """hashes of the files, and all it takes to make them again"""
    removed_stage: str | None
    """of an earlier batch in the same folder, where this one exports no worlds"""
    scene: str
    device: str
    schedule: str
    workers: int
    """processes that simulated: 1 without a cluster"""
    worlds: int
    exported_worlds: int
    unhealthy_worlds: int
    """worlds that blew up; their rows stay at the last good frame"""
    restarted_worlds: int
    """worlds that blew up, and did not with shorter steps"""
    blow_ups: list[str]
    """why the first few worlds blew up"""
    particles: int
    """in all worlds"""
    springs: int
    """in all worlds"""
    frames: int
    substeps: int
    """in one frame"""
    wall_seconds: float
    """of simulating and writing, once there are workers"""
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
    on_blowup: str = "freeze",
    cluster: Cluster | None = None,
    provenance: Mapping[str, Any] | None = None,
    on_frame: Callable[[int], None] = lambda number: None,
    on_warning: Callable[[str], None] = lambda sentence: None,
) -> BatchSummary:
    """Simulate worlds that differ; write `table.npz`, `table.csv`, of the chosen worlds `worlds.usdc`, and
    `manifest.json`, from which `repeat_batch` makes them again.

    All in the folder is of one batch: where no world is chosen, the `worlds.usdc` of an earlier one is removed.

    Args:
        scene: what all worlds have in common.
        folder: where the files go; made if it is not there.
        world_count: how many worlds.
        vary: what differs: dotted paths as in overrides, and a value for each world, shape (world_count,).
        export: the worlds that go into the stage.
        name: what the summary calls the scene.
        device: a Warp device; the GPU where there is one, when missing.
        schedule: "scatter", "gather", "block", "lanes", "octets", or "auto" for the fastest.
        on_blowup: what becomes of a world that blows up: "freeze" keeps its rows at its last good frame; "restart"
            simulates it anew after the others with half the step, `MOST_HALVINGS` times at most; "stop" ends all.
        cluster: the workers that simulate it; this process does, when missing. The files are the same.
        provenance: what the manifest is to say of where all this comes from, such as a command and a seed.
        on_frame: told the number of each frame when it is simulated; on a cluster, now and then, of the average world.
        on_warning: told what is odd about each mesh, and what became of it.

    Raises:
        InputError: the scene cannot be simulated, a varied value is wrong, the worlds do not fit into the memory, or
            the folder cannot be written, or the cluster is not there; nothing is written then.
        BlowUpError: a world blew up, which is to stop all; nothing is written then.
        MissingExtraError: a cluster is given and dask.distributed is not installed.
        WorkersLostError: the cluster's workers end, or its scheduler does; nothing is written then.
    """
    check_policy(on_blowup)
    vary, chosen = vary or {}, np.unique(np.asarray(export, dtype=np.int64))
    if len(chosen) and not 0 <= chosen[0] <= chosen[-1] < world_count:
        raise InputError(f"export: expected worlds 0 to {world_count - 1} (got {chosen[0]} to {chosen[-1]})")
    worker_device = cluster.device(device) if cluster else device
    task = BatchTask(scene, plan_groups(scene, world_count, vary), vary, chosen, Path(folder), schedule, on_blowup)
    for warning in dict.fromkeys(sentence for group in task.groups for sentence in group.plan.warnings):
        on_warning(warning)
    description = describe_batch(task)
    if cluster:
        from balloon_warp.sweep.distribute import distribute_batch  # only this needs the extra

        outcome = distribute_batch(task, cluster, worker_device, on_frame)
    else:
        outcome = _simulate_here(task, device, on_frame)
    names = ["table.npz", "table.csv", *([STAGE_NAME] if len(chosen) else [])]
    write_manifest(task, description, {"name": name, **(provenance or {})}, outcome, names)
    substeps = task.groups[0].plan.substeps
    particles = sum(len(group.worlds) * group.plan.particle_count for group in task.groups)
    return BatchSummary(
        output=str(folder),
        table=[str(task.folder / "table.npz"), str(task.folder / "table.csv")],
        stage=str(task.folder / STAGE_NAME) if len(chosen) else None,
        manifest=str(task.folder / MANIFEST_NAME),
        removed_stage=str(task.folder / STAGE_NAME) if outcome.removed_stage else None,
        scene=name,
        device=outcome.device,
        schedule=outcome.schedule,
        workers=outcome.workers,
        worlds=world_count,
        exported_worlds=len(chosen),
        unhealthy_worlds=world_count - outcome.healthy_worlds,
        restarted_worlds=len(outcome.failures.restarted),
        blow_ups=[str(report) for report in outcome.failures.reports],
        particles=particles,
        springs=sum(len(group.worlds) * group.plan.spring_count for group in task.groups),
        frames=scene.frames,
        substeps=substeps,
        wall_seconds=round(outcome.seconds, 3),
        particle_substeps_per_second=round(particles * substeps * scene.frames / outcome.seconds),
    )


def _simulate_here(task: BatchTask, device: str | None, on_frame: Callable[[int], None]) -> Outcome:
    """All worlds at once, in this process."""
    began = time.perf_counter()
    target = pick_device(device)
    models = [lay_out(group.plan, target) for group in task.groups]
    schedules = [settled_solver(task.schedule, model, task.world_count) for model in models]
    require_batch_memory(models, schedules, task.groups, task.chosen, task.scene, frames_held=WAITING + 2)
    simulators = [Simulator.of_model(*pair) for pair in zip(models, schedules, strict=True)]
    failures = Failures()
    with BatchOutput(task.folder, task.scene, task.groups, task.chosen, task.vary) as output:
        _simulate_frames(task, simulators, output, on_frame)
        if output.healthy_count < task.world_count:
            failures = _report_all(task, output, simulators)
            simulators.clear()  # what begins again has their memory
            if task.on_blowup == "restart":
                failures.add(_restart_all(task, output, target, schedules))
    return Outcome(
        device=str(target),
        schedule=", ".join(sorted(set(schedules))),
        workers=1,
        healthy_worlds=output.healthy_count,
        failures=failures,
        seconds=time.perf_counter() - began,
        removed_stage=output.removed_stage,
    )


def _simulate_frames(
    task: BatchTask, simulators: Sequence[Simulator], output: BatchOutput, on_frame: Callable[[int], None]
) -> None:
    """All frames of all groups, which are written meanwhile."""
    recorders = [
        Recorder(simulator, group.rows_of(task.chosen))
        for simulator, group in zip(simulators, task.groups, strict=True)
    ]
    with Background() as writer:
        for number in range(task.scene.frames + 1):
            for simulator in simulators if number else ():
                simulator.advance()
            records = [recorder.read() for recorder in recorders]
            if task.on_blowup == "stop":
                for each in zip(simulators, task.groups, records, strict=True):
                    require_health(*each)
            writer.submit(output.write, records)
            on_frame(number)


def _report_all(task: BatchTask, output: BatchOutput, simulators: Sequence[Simulator]) -> Failures:
    """Why worlds blew up."""
    failures = Failures()
    for number, each in enumerate(zip(simulators, task.groups, strict=True)):
        failures.add(Failures(report_failures(*each, output.health_of(number))))
    return failures


def _restart_all(task: BatchTask, output: BatchOutput, device: wp.Device, schedules: Sequence[str]) -> Failures:
    """Simulate the worlds that blew up again in shorter steps, and put that in their place."""
    failures = Failures()
    for number, (group, schedule) in enumerate(zip(task.groups, schedules, strict=True)):
        bad, put = np.flatnonzero(output.health_of(number)[-1] == 0), partial(output.replace, number)
        failures.add(Failures([], restart_failures(group, bad, task.chosen, device, schedule, put)))
    output.rewrite_table()
    return failures

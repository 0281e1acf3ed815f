"""A batch in this process: all worlds at once, on one device, in memory checked before."""

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.batch.output import BatchOutput
from balloon_warp.batch.recorder import (
    Group,
    Record,
    Recorder,
    bytes_of_frame,
    columns_of,
    contact_bytes,
    picked_bytes,
    record_bytes,
)
from balloon_warp.batch.task import BatchTask, Failures, Outcome, report_failures, require_health, restart_failures
from balloon_warp.kernels.laws import Law
from balloon_warp.model import Model, lay_out, plan_model, remarks_on, world_bytes
from balloon_warp.model.shape import shape_balloon
from balloon_warp.model.state import require_memory
from balloon_warp.model.timeline import SHAPING
from balloon_warp.run.checkpoints import WAITING, Checkpoints, record_frames
from balloon_warp.run.provenance import RunHeader
from balloon_warp.scene import Scene
from balloon_warp.simulator import Simulator
from balloon_warp.solvers import resolved_solver, solver_named
from balloon_warp.system.streams import Interrupts
from balloon_warp.system.warp_threads import lock_of, pick_device

MANY = 50_000
"""Number of worlds whose values take longer to make than the size of one world takes to find"""
SOME = 64
"""Number of worlds at which one takes no more memory than with many: schedules lay out several side by side"""


def require_room(
    scene: Scene,
    world_count: int,
    varied: Collection[str] = (),
    device: str | None = None,
    schedule: str = "auto",
    laws: Sequence[Law] = (),
    spread: bool = False,
) -> None:
    """Make sure that so many worlds could fit, before each gets its values.

    That is where they are very many, and all of one size.

    Args:
        varied: the paths of values that differ.
        device: Warp device; the GPU, or else the CPU, if not given.
        spread: whether workers simulate them, and only the table is here.

    Raises:
        InputError: they could not, or the scene cannot be simulated, or there is no such device or schedule.
    """
    if world_count < MANY or any(map(SHAPING.fullmatch, varied)):
        return
    on_host = table_bytes(scene)
    if not spread:
        shapes = [shape_balloon(balloon, scene, as_soft_as_can_be=True) for balloon in scene.balloon]
        model = lay_out(plan_model(scene, SOME, shapes=shapes, laws=laws), pick_device(device))
        solver = solver_named(resolved_solver(schedule, model, world_count), model)
        simulated = world_bytes(model) + solver.world_bytes(model)
        require_memory(model.device, [world_count], [simulated])
        on_host += simulated if model.device.is_cpu else 0
    require_memory(pick_device("cpu"), [world_count], [on_host])


def require_batch_memory(
    models: Sequence[Model],
    schedules: Sequence[str],
    groups: Sequence[Group],
    chosen: NDArray[np.integer],
    scene: Scene,
    frames_held: int,
    every: int = 0,
) -> None:
    """Make sure that all worlds fit on the device, and the table and some frames of the chosen worlds on the host.

    Args:
        models: of the groups, all on one device.
        schedules: the name of each one's.
        frames_held: frames of the chosen worlds that are in the host's memory at a time.
        every: step between frames that go into files of worlds, and are held likewise; 0 for none.

    Raises:
        InputError: they do not, and the message says how many worlds would; or there is no such schedule.
    """
    counts = [len(group.worlds) for group in groups]
    on_device, on_host = [], []
    for model, schedule, group in zip(models, schedules, groups, strict=True):
        picked = picked_bytes(group.plan) * len(group.rows_of(chosen)) // len(group.worlds)
        simulated = world_bytes(model) + solver_named(schedule, model).world_bytes(model)
        on_device.append(simulated + record_bytes(group.plan) + picked)
        tracked = bytes_of_frame(group.plan) * -(-frames_held // every) if every else 0
        on_host.append(table_bytes(scene) + contact_bytes(group.plan) + frames_held * picked + tracked)
    device = models[0].device
    if device.is_cpu:
        on_host = [sum(both) for both in zip(on_device, on_host, strict=True)]
    else:
        require_memory(device, counts, on_device)
    require_memory(pick_device("cpu"), counts, on_host)


def table_bytes(scene: Scene) -> int:
    """Return the host memory of a world's rows of the table: its measures and its health in every frame."""
    return 4 * (scene.frames + 1) * (len(columns_of(scene)) + 1)


def simulate_locally(
    task: BatchTask,
    device: str | None,
    checkpoints: Checkpoints,
    on_begin: Callable[[RunHeader], None],
    on_frame: Callable[[int], None],
) -> Outcome:
    """Simulate a batch and write its table and its stage.

    Args:
        device: Warp device; the GPU, or else the CPU, if not given.
        checkpoints: which keep the batch safe meanwhile, and from which it goes on.
        on_begin: called once all is laid out.
        on_frame: Called with the number of each simulated frame.

    Raises:
        InputError, BlowUpError, KeyboardInterrupt: as `run_batch`.
    """
    began = time.perf_counter()
    target = pick_device(device)
    with lock_of(target):
        models = [lay_out(group.plan, target) for group in task.groups]
        schedules = [resolved_solver(task.schedule, model, task.world_count) for model in models]
        require_batch_memory(models, schedules, task.groups, task.chosen, task.scene, WAITING + 2, task.every)
        simulators = [Simulator.of_model(*pair) for pair in zip(models, schedules, strict=True)]
    failures, named = Failures(), ", ".join(sorted(set(schedules)))
    on_begin(task.header(str(target), named))
    with BatchOutput(task, task.groups) as output:
        begin = _simulate_frames(task, simulators, output, checkpoints, on_frame)
        with lock_of(target):
            overflow = sum(simulator.schedule.overflow for simulator in simulators)
            remarks = [
                remark
                for simulator, group in zip(simulators, task.groups, strict=True)
                for remark in remarks_on(simulator.model, simulator.state, group.worlds)
            ]
        if output.healthy_count < task.world_count:
            failures = _report_all(task, output, simulators)
            simulators.clear()  # restarted worlds reuse their memory
            if task.on_blowup == "restart":
                bad = task.world_count - output.healthy_count
                checkpoints.on_note(
                    f"{bad:,} of {task.world_count:,} worlds blew up: restarting them with half the step"
                )
                failures.add(_restart_all(task, output, target, schedules))
        endings = output.endings()
        hashes = output.finish()
    return Outcome(
        device=str(target),
        schedule=named,
        workers=1,
        healthy_worlds=output.healthy_count,
        failures=failures,
        bad_endings=endings,
        pairs=output.pairs,
        remarks=remarks,
        overflow=overflow,
        seconds=time.perf_counter() - began,
        resumed=max(begin - 1, 0) / task.scene.frames,
        removed_stage=output.removed_stage,
        hashes=hashes,
    )


def _simulate_frames(
    task: BatchTask,
    simulators: Sequence[Simulator],
    output: BatchOutput,
    checkpoints: Checkpoints,
    on_frame: Callable[[int], None],
) -> int:
    """Simulate all frames of all groups, and write them meanwhile; return the first that was not there already."""
    recorders = [
        Recorder(simulator, group.rows_of(task.chosen), task.every)
        for simulator, group in zip(simulators, task.groups, strict=True)
    ]
    with Interrupts() as interrupts:
        begin = _take_up(checkpoints, output, simulators, recorders)
        output.begin_trajectories(begin > 0)
        record_frames(
            _frames(task, simulators, recorders, begin),
            output,
            checkpoints,
            [recorder.save for recorder in recorders],
            interrupts,
            on_frame,
        )
    return begin


def _frames(
    task: BatchTask, simulators: Sequence[Simulator], recorders: Sequence[Recorder], begin: int
) -> Iterator[tuple[int, list[Record]]]:
    """Simulate frame by frame; yield the number and a record of each group.

    Raises:
        BlowUpError: a world blew up, which is to stop all.
    """
    for number in range(begin, task.scene.frames + 1):
        for simulator in simulators if number else ():
            simulator.advance()
        records = [recorder.read() for recorder in recorders]
        if task.on_blowup == "stop":
            for each in zip(simulators, task.groups, records, strict=True):
                require_health(*each)
        yield number, records


def _take_up(
    checkpoints: Checkpoints, output: BatchOutput, simulators: Sequence[Simulator], recorders: Sequence[Recorder]
) -> int:
    """Take up the frames that an earlier batch saved, where that is wanted; return the first frame that is missing."""
    device = simulators[0].model.device
    begin = 0
    for part in checkpoints.take_up(
        output,
        simulated="in one process",
        device=device.name if device.is_cuda else "cpu",
        schedules=[simulator.schedule.name for simulator in simulators],
    ):
        begin = part.frames.stop
        for _ in part.frames:
            output.end_frame()
    checkpoints.restore(begin, [recorder.restore for recorder in recorders])
    return begin


def _report_all(task: BatchTask, output: BatchOutput, simulators: Sequence[Simulator]) -> Failures:
    """Explain why worlds blew up."""
    failures = Failures()
    for number, each in enumerate(zip(simulators, task.groups, strict=True)):
        failures.add(Failures(report_failures(*each, output.health_of(number))))
    return failures


def _restart_all(task: BatchTask, output: BatchOutput, device: wp.Device, schedules: Sequence[str]) -> Failures:
    """Simulate the worlds that blew up again in shorter steps, and put that in their place."""
    failures = Failures()
    for number, (group, schedule) in enumerate(zip(task.groups, schedules, strict=True)):
        bad, put = np.flatnonzero(output.health_of(number)[-1] == 0), partial(output.replace, number)
        failures.add(Failures([], restart_failures(group, bad, task.chosen, device, schedule, put, task.every)))
    output.rewrite_table()
    return failures

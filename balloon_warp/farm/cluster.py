"""Cluster: the workers to which the shares of a batch are distributed; its files are written here."""

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from math import ceil, log2
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from balloon_warp.batch.local import require_batch_memory, table_bytes
from balloon_warp.batch.output import BatchOutput
from balloon_warp.batch.recorder import SHAPES, Group, Record, Recorder
from balloon_warp.batch.task import (
    BatchPlace,
    BatchTask,
    Failures,
    Outcome,
    Rows,
    SimulateBatch,
    report_failures,
    require_health,
    restart_failures,
)
from balloon_warp.errors import WorkersLostError
from balloon_warp.farm.remote import Work, connect, modules_of, require_laws_that_travel, run_shares
from balloon_warp.farm.workers import WorkerOptions, Workers
from balloon_warp.kernels.lanes import LANE_COUNT
from balloon_warp.model import ModelPlan, Remark, lay_out, remarks_on
from balloon_warp.model.state import require_memory
from balloon_warp.run.checkpoints import Checkpoints, Part
from balloon_warp.run.provenance import RunHeader
from balloon_warp.simulator import Simulator
from balloon_warp.solvers import resolved_solver
from balloon_warp.system.streams import Interrupts
from balloon_warp.system.warp_threads import pick_device

SHARES = 64
"""Approximate number of shares of a large batch: enough to keep many workers busy to the end"""


class Grain(NamedTuple):
    """Least size of a share: enough to fill a device and to be worth its overhead."""

    worlds: int
    particles: int
    particle_substeps: int = 0
    """Number of particle-substeps in all its frames, unless that takes more than `MOST_PARTICLES`"""

    def particles_of(self, plan: ModelPlan) -> float:
        """Find how many particles a share has at least, of worlds of a plan."""
        worth = self.particle_substeps / (plan.substeps * plan.scene.frames)
        return max(self.particles, min(worth, MOST_PARTICLES))


MOST_PARTICLES = 2**23
"""Largest number of particles of a share that more than fills a device: as many fit into the memory of any"""
GRAIN = {"cpu": Grain(LANE_COUNT, 2**11), "cuda": Grain(1, 2**18, 2**35)}
"""Least sizes by the kind of device; on a CPU `lanes` takes as long for one world as for eight; a GPU does that work in
a third of a second or, where it is much, in three, and a share has an overhead of a tenth or more"""


@dataclass(frozen=True)
class ShareResult:
    """Result of a share from a worker."""

    records: list[Record]
    """Records of all frames, including the start"""
    schedule: str
    failures: Failures
    remarks: list[Remark]
    overflow: int
    """Number of contacts that were ignored, as schedules count them"""


def cut_into_shares(groups: Sequence[Group], device_kind: str) -> list[Group]:
    """Cut groups into groups of fewer worlds.

    The cut depends on the batch and the kind of device, "cpu" or "cuda", and never on the number of workers. It has the
    planned step of the whole, and the geometry, so that a worker needs neither the other worlds nor any file.
    """
    world_count = sum(len(group.worlds) for group in groups)
    least = GRAIN[device_kind]
    shares = []
    for group in groups:
        enough = max(least.worlds, least.particles_of(group.plan) / group.plan.particle_count)
        size = 2 ** ceil(log2(max(world_count / SHARES, enough)))
        begin = 0
        for worlds in np.array_split(group.worlds, ceil(len(group.worlds) / size)):
            shares.append(group.part(np.arange(begin, begin + len(worlds))))
            begin += len(worlds)
    return shares


def simulate_share(
    share: Group,
    chosen: NDArray[np.integer],
    device: str | None,
    schedule: str,
    world_count: int,
    on_blowup: str,
    on_frame: Callable[[int], None],
    every: int = 0,
) -> ShareResult:
    """Simulate a share from its start to its end.

    Args:
        chosen: the worlds whose shape is wanted, by their numbers in the batch.
        device: Warp device; the GPU, or else the CPU, if not given.
        schedule: Parallel schedule: "scatter", "gather", "block", "lanes", "octets", or "auto" for the fastest.
        world_count: how many worlds the whole batch has.
        on_blowup: as in `run_batch`.
        on_frame: Called with the number of each simulated frame.
        every: Interval of recorded frames, as in `Recorder`.

    Raises:
        InputError: there is no such device or schedule, or the share does not fit into its memory.
        BlowUpError: a world blew up, which is to stop all.
    """
    scene = share.plan.scene
    model = lay_out(share.plan, pick_device(device))
    settled = resolved_solver(schedule, model, world_count)
    require_batch_memory([model], [settled], [share], chosen, scene, scene.frames + 1, every)
    simulator = Simulator.of_model(model, settled)
    recorder = Recorder(simulator, share.rows_of(chosen), every)
    records: list[Record] = []
    for record in recorder.run():
        records.append(record)
        if on_blowup == "stop":
            require_health(simulator, share, record)
        on_frame(record.number)
    health = np.stack([record.healthy for record in records])
    failures, overflow = Failures(report_failures(simulator, share, health)), simulator.schedule.overflow
    remarks = remarks_on(simulator.model, simulator.state, share.worlds)
    del simulator, recorder  # restarted worlds reuse their memory
    if on_blowup == "restart":
        bad, put = np.flatnonzero(health[-1] == 0), partial(_replace, records)
        failures.restarted = restart_failures(share, bad, chosen, model.device, settled, put, every)
    return ShareResult(records, settled, failures, remarks, overflow)


def _replace(records: list[Record], rows: Rows, places: Rows, part: Record) -> None:
    """See `restart_failures`."""
    record = records[part.number]
    for array, values in ((record.measures, part.measures), (record.healthy, part.healthy)):
        array[rows] = values
    if record.contacts is not None and part.contacts is not None:
        record.contacts[rows] = part.contacts
    for name, values in (part.tracks or {}).items():
        if record.tracks is not None:
            record.tracks[name][rows] = values
    for name in SHAPES:
        getattr(record, name)[places] = getattr(part, name)


FAILURES = TypeAdapter(Failures)
"""Conversion to JSON and back"""


class ShareJournal:
    """Puts shares into the output as they come, and those of an earlier batch first, where that is wanted.

    Args:
        task: of the batch.
        output: of the shares, in their order.
        checkpoints: where they are kept.
        device_kind: "cpu" or "cuda", on which the cut depends.

    Raises:
        InputError: as `Checkpoints.take_up`.
    """

    def __init__(self, task: BatchTask, output: BatchOutput, checkpoints: Checkpoints, device_kind: str):
        self._output, self._checkpoints = output, checkpoints
        self._frames = range(task.scene.frames + 1)
        self.schedules: dict[int, str] = {}
        """Schedules of the shares that are done, by their numbers"""
        self.failures = Failures()
        self.remarks: list[Remark] = []
        """Remarks on worlds of the shares that this batch has done"""
        self.overflow = 0
        """Contacts that were ignored in the shares that this batch has done, as schedules count them"""
        self._unsafe: list[int] = []
        self._unsafe_failures = Failures()
        for part in checkpoints.take_up(
            output,
            simulated=f"in {len(output.groups)} shares",
            device=device_kind,
            schedule=task.schedule,
        ):
            self.schedules.update(zip(part.groups, part.notes["schedules"], strict=True))
            self.failures.add(FAILURES.validate_python(part.notes["failures"]))
        self.resumed = sum(len(output.groups[number].worlds) for number in self.schedules) / task.world_count
        """Fraction of the worlds that an earlier batch had simulated"""
        if self.schedules:
            shares = f"{len(self.schedules)} of {len(output.groups)} shares"
            checkpoints.on_note(f"resuming with {shares} done, from {checkpoints.folder.path}")

    def add(self, number: int, result: ShareResult) -> None:
        """Add a share that is done."""
        for record in result.records:
            self._output.add(number, record)
        self.schedules[number] = result.schedule
        self.remarks += result.remarks
        self.overflow += result.overflow
        for failures in (self.failures, self._unsafe_failures):
            failures.add(result.failures)
        self._unsafe.append(number)

    def save(self) -> None:
        """Write a checkpoint of the shares that were done since the last, if there are any.

        Raises:
            InputError: it cannot be written; earlier files stay.
        """
        if self._unsafe:
            notes = {
                "schedules": [self.schedules[number] for number in self._unsafe],
                "failures": FAILURES.dump_python(self._unsafe_failures),
            }
            self._checkpoints.save_part(self._output, Part(self._frames, self._unsafe, notes))
            self._unsafe, self._unsafe_failures = [], Failures()


def distribute_batch(
    task: BatchTask,
    device: str | None,
    checkpoints: Checkpoints,
    on_begin: Callable[[RunHeader], None],
    on_frame: Callable[[int], None],
    *,
    cluster: WorkerOptions,
    workers: Workers,
) -> Outcome:
    """Simulate a batch on workers, and write its files here, as if it had been simulated here.

    Args:
        device: the Warp device of each worker; its GPU where it has one, when missing.
        checkpoints: of shares that are done; those that were when the last one was written are not done again.
        on_begin: called once there are workers; they choose the schedule themselves.
        on_frame: told how many frames are simulated, on the average of all worlds.

    Raises:
        InputError, BlowUpError, MissingExtraError, WorkersLostError, KeyboardInterrupt: as `run_batch`.
    """
    _require_table_memory(task)
    require_laws_that_travel(task.laws, cluster)
    devices = workers.devices(device, [__name__, *modules_of(task.laws)])
    named = ", ".join(sorted(set(devices)))
    on_begin(task.header(named, task.schedule, len(devices)))
    began = time.perf_counter()
    # Where workers differ, the shares are small enough for the least of them.
    kind = "cuda" if all(name.startswith("cuda") for name in devices) else "cpu"
    shares = cut_into_shares(task.groups, kind)
    with (
        BatchOutput(task, shares) as output,
        Interrupts() as interrupts,
    ):
        journal = ShareJournal(task, output, checkpoints, kind)
        output.begin_trajectories(bool(journal.schedules))
        try:
            work = _work(task, shares, journal.schedules, device)
            for done in run_shares(workers, work, len(devices), on_frame, checkpoints.on_note):
                if done:
                    journal.add(*done)
                if checkpoints.due or interrupts.pending:
                    journal.save()
                interrupts.deliver()
        except WorkersLostError as loss:
            journal.save()
            interrupts.deliver()  # a signal that ends this process may have ended the workers first
            raise WorkersLostError(f"{loss}; {checkpoints.advice}") from None
        endings = output.endings()
        with ThreadPoolExecutor(1) as beside:
            ended = beside.submit(workers.close)
            hashes = output.finish(task.scene.frames + 1)
            ended.result()
    return Outcome(
        device=named,
        schedule=", ".join(sorted(set(journal.schedules.values()))),
        workers=len(devices),
        healthy_worlds=output.healthy_count,
        failures=journal.failures,
        bad_endings=endings,
        pairs=output.pairs,
        remarks=journal.remarks,
        overflow=journal.overflow,
        seconds=time.perf_counter() - began,
        resumed=journal.resumed,
        removed_stage=output.removed_stage,
        hashes=hashes,
    )


def _require_table_memory(task: BatchTask) -> None:
    """Make sure that the table fits, which is in memory."""
    counts = [len(group.worlds) for group in task.groups]
    require_memory(pick_device("cpu"), counts, [table_bytes(task.scene)] * len(counts))


def _work(task: BatchTask, shares: Sequence[Group], done: Collection[int], device: str | None) -> Work:
    """Return the work for workers: the shares whose numbers are not among those that are done."""
    told = (task.chosen, device, task.schedule, task.world_count, task.on_blowup)
    return Work(
        partial(simulate_share, every=task.every),
        {number: (share, *told) for number, share in enumerate(shares) if number not in done},
        [len(share.worlds) / task.world_count for share in shares],
        task.scene.frames,
    )


@dataclass(frozen=True)
class Cluster(WorkerOptions, BatchPlace):
    """Workers that simulate a batch: one of `address`, `gpus` and `workers` is given.

    Raises:
        InputError: none or several are, the address is none, or a number is below 1.
    """

    @contextmanager
    def started(self) -> Iterator[SimulateBatch]:
        """Start the workers, or connect to them; those that are started end with the `with` block.

        Raises:
            MissingExtraError, InputError: as `connect`.
        """
        with connect(self, __name__) as workers:
            yield partial(distribute_batch, cluster=self, workers=workers)

"""Cluster: the workers to which a batch is distributed; its files are written here."""

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

from balloon_warp.batch.local import table_bytes
from balloon_warp.batch.output import BatchOutput
from balloon_warp.batch.recorder import Group
from balloon_warp.batch.task import BatchPlace, BatchTask, Outcome, SimulateBatch
from balloon_warp.errors import WorkersLostError
from balloon_warp.farm.remote import Work, connect, modules_of, require_laws_that_travel, run_shares
from balloon_warp.farm.shares import ShareJournal, cut_into_shares, simulate_share
from balloon_warp.farm.workers import WorkerOptions, Workers
from balloon_warp.model.memory import require_memory
from balloon_warp.run.checkpoints import Checkpoints
from balloon_warp.run.provenance import Beginning
from balloon_warp.system.streams import Interrupts
from balloon_warp.system.warp_threads import pick_device


def distribute_batch(
    task: BatchTask,
    device: str | None,
    checkpoints: Checkpoints,
    on_begin: Callable[[Beginning], None],
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
    on_begin(task.beginning(named, task.schedule, len(devices)))
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


SHARES = "balloon_warp.farm.shares"
"""Module that simulates shares"""


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
        with connect(self, SHARES) as workers:
            yield partial(distribute_batch, cluster=self, workers=workers)

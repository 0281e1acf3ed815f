"""The shares of a batch on many workers: they go out, and their results come back in any order."""

import pickle
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from balloon_warp.beginning import Beginning
from balloon_warp.device import pick_device
from balloon_warp.errors import InputError, WorkersLostError
from balloon_warp.interrupts import Interrupts
from balloon_warp.kernels.laws import Law
from balloon_warp.model.memory import require_memory
from balloon_warp.outputs.background import Background
from balloon_warp.resume import Checkpoints
from balloon_warp.sweep.cluster import Cluster, connect
from balloon_warp.sweep.groups import Group
from balloon_warp.sweep.journal import ShareJournal
from balloon_warp.sweep.memory import table_bytes
from balloon_warp.sweep.output import BatchOutput
from balloon_warp.sweep.shares import ShareResult, cut_into_shares, simulate_share
from balloon_warp.sweep.task import BatchTask, Outcome

if TYPE_CHECKING:
    from distributed import Client, Future

REPORT_SECONDS = 0.1
"""Time between two reports of a worker on its current frame [s]"""
LOOK_SECONDS = 0.5
"""Time after which the wait for workers is interrupted [s]"""
ALONE_SECONDS = 60.0
"""Time after which ended workers are not waited for any more [s]: Dask may not have restarted them"""
AHEAD = 2
"""Number of shares that are out, for each worker: one at work and one that follows; more would only fill the memory"""

LOADING = """
from balloon_warp.garbage import without_collecting
with without_collecting():
    import {}
"""
"""Code by which a worker loads a module"""

_one_at_a_time = threading.Lock()  # a worker may have many threads, but it has one device


def distribute_batch(
    task: BatchTask,
    cluster: Cluster,
    device: str | None,
    checkpoints: Checkpoints,
    on_begin: Callable[[Beginning], None],
    on_frame: Callable[[int], None],
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
    _require_laws_that_travel(task, cluster)
    with ExitStack() as workers:
        client = workers.enter_context(connect(cluster))
        devices = _worker_devices(client, cluster, device, task.laws)
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
                for done in _run_shares(
                    client, cluster, task, shares, journal.schedules, device, len(devices), on_frame
                ):
                    if done:
                        journal.add(*done)
                    if checkpoints.due or interrupts.pending:
                        journal.save()
                    interrupts.deliver()
            except WorkersLostError as loss:
                journal.save()
                interrupts.deliver()  # a signal that ends this process may have ended the workers first
                raise WorkersLostError(f"{loss}; {checkpoints.advice}") from None
            with Background() as writer:
                writer.submit(_write_table, task, output)
                workers.close()  # which end meanwhile
            endings = output.endings()
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
        )


def _write_table(task: BatchTask, output: BatchOutput) -> None:
    """Write the table once all shares are there: a row of the text has the worlds of one frame, from all shares."""
    for _ in range(task.scene.frames + 1):
        output.end_frame()


def _require_table_memory(task: BatchTask) -> None:
    """Make sure that the table fits, which is in memory."""
    counts = [len(group.worlds) for group in task.groups]
    require_memory(pick_device("cpu"), counts, [table_bytes(task.scene)] * len(counts))


def _require_laws_that_travel(task: BatchTask, cluster: Cluster) -> None:
    for law in task.laws:
        try:
            pickle.dumps(law)
        except pickle.PicklingError as error:
            raise InputError(f"{cluster.option}: {error}") from None


def _worker_devices(client: "Client", cluster: Cluster, device: str | None, laws: Sequence[Law]) -> list[str]:
    """Ask for the device of each worker, such as "cpu" or "cuda:0".

    Raises:
        InputError: a worker has no such device; or it, or the scheduler, has no Balloon Warp, or not the module of a
            law.
    """
    for module in (__name__, *(law.force.func.__module__ for law in laws)):
        try:
            for run in (client.run_on_scheduler, client.run):  # Dask's scheduler opens what passes through it
                run(exec, LOADING.format(module))
        except ImportError as error:
            what = "Balloon Warp" if module == __name__ else f"{module}, which has a law"
            raise InputError(f"{cluster.option}: its scheduler or a worker cannot load {what}: {error}") from None
    names: Any = client.run(_device_name, device, cluster.prepare)
    return list(names.values())


def _run_shares(
    client: "Client",
    cluster: Cluster,
    task: BatchTask,
    shares: Sequence[Group],
    without: Collection[int],
    device: str | None,
    worker_count: int,
    on_frame: Callable[[int], None],
) -> Iterator[tuple[int, ShareResult] | None]:
    """Simulate the shares, and give each one's number and result as it comes, and nothing now and then meanwhile.

    Shares of a lost worker are simulated again.

    Args:
        task: what the shares are of.
        without: the numbers of those that are done already.
        device: the Warp device of each worker; its GPU where it has one, when missing.
        worker_count: how many workers there are.
        on_frame: told how many frames are simulated, on the average of all worlds.

    Raises:
        InputError: a share does not fit into a worker's memory.
        BlowUpError: a world blew up, which is to stop all.
        WorkersLostError: a share lost one worker after the other, no worker is left, or the scheduler is gone.
    """
    topic = f"balloon-warp-{uuid4().hex}"
    events: SimpleQueue[tuple[int, int | Future]] = SimpleQueue()  # a share, and its frame or its end
    client.subscribe_topic(topic, lambda event: events.put(event[1]))
    missing = {number for number in range(len(shares)) if number not in without}
    waiting = iter(sorted(missing))

    def send_next() -> None:
        if (number := next(waiting, None)) is not None:
            share = (shares[number], task.chosen, device, task.schedule, task.world_count)
            told = (task.on_blowup, task.every, cluster.prepare, topic, number)
            future = client.submit(_work, *share, *told, key=f"{topic}-{number}", pure=False)
            future.add_done_callback(lambda done: events.put((number, done)))

    for _ in range(AHEAD * worker_count):
        send_next()
    frames = np.array([0 if number in missing else task.scene.frames for number in range(len(shares))])
    weights = np.array([len(share.worlds) for share in shares]) / task.world_count
    in_company = time.monotonic()
    while missing:
        try:
            number, news = events.get(timeout=LOOK_SECONDS)
        except Empty:
            yield None
            if _has_workers(client):
                in_company = time.monotonic()
            elif time.monotonic() - in_company > ALONE_SECONDS:
                raise WorkersLostError(f"all workers ended, and none came for {ALONE_SECONDS:g} s") from None
            continue
        in_company = time.monotonic()
        if isinstance(news, int):
            frames[number] = news
            yield None
        else:
            result = _result(client, news)
            frames[number] = len(result.records) - 1
            missing.remove(number)
            send_next()
            yield number, result
        on_frame(int(frames @ weights + 1.0e-6))


def _has_workers(client: "Client") -> bool:
    """Return whether there are any workers; a scheduler that is gone reports itself otherwise."""
    try:
        return bool(client.nthreads())
    except OSError:
        return True


def _result(client: "Client", future: "Future") -> ShareResult:
    """Return the result of a share; it is computed again if its worker ends before the result is here."""
    from distributed.scheduler import KilledWorker

    seconds = ALONE_SECONDS
    try:
        while True:
            try:
                return future.result(timeout=seconds)
            except TimeoutError:
                if not _has_workers(client):
                    raise WorkersLostError(f"all workers ended, and none came for {ALONE_SECONDS:g} s") from None
                seconds *= 2.0  # it begins anew, and may be large
    except KilledWorker as error:
        raise WorkersLostError(
            f"a share of the batch ended {error.allowed_failures + 1} workers, one after the other"
        ) from None
    except CancelledError:
        raise WorkersLostError("the scheduler is gone") from None


def _work(
    share: Group,
    chosen: NDArray[np.integer],
    device: str | None,
    schedule: str,
    world_count: int,
    on_blowup: str,
    every: int,
    prepare: Callable[[], None] | None,
    topic: str,
    number: int,
) -> ShareResult:
    """Simulate a share on a worker."""
    from distributed import get_worker

    worker, last = get_worker(), time.monotonic()

    def report(frame: int) -> None:
        nonlocal last
        if (now := time.monotonic()) - last > REPORT_SECONDS:
            worker.log_event(topic, (number, frame))
            last = now

    with _one_at_a_time:
        if prepare:
            prepare()
        return simulate_share(share, chosen, device, schedule, world_count, on_blowup, report, every)


def _device_name(device: str | None, prepare: Callable[[], None] | None) -> str:
    """Name the device of a worker, on the worker."""
    if prepare:
        prepare()
    return str(pick_device(device))

"""Cluster: shares of a batch on workers, of this machine or of a Dask scheduler; its files are written here."""

import logging
import pickle
import threading
import time
from collections import Counter
from collections.abc import Callable, Collection, Container, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from math import ceil, log2
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, NamedTuple
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from balloon_warp.batch.batch import require_batch_memory, table_bytes
from balloon_warp.batch.recorder import SHAPES, Group, Record, Recorder
from balloon_warp.batch.task import (
    BatchOutput,
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
from balloon_warp.errors import InputError, MissingExtraError, NoRoomError, WorkersLostError
from balloon_warp.farm.workers import Call, NoRoom, WorkerOptions, Workers
from balloon_warp.kernels.lanes import LANE_COUNT
from balloon_warp.kernels.laws import Law
from balloon_warp.model import ModelPlan, Remark, lay_out, remarks_on
from balloon_warp.model.state import require_memory
from balloon_warp.run.checkpoints import Checkpoints, Part
from balloon_warp.run.report import RunHeader
from balloon_warp.simulator import Simulator
from balloon_warp.solvers import resolved_solver
from balloon_warp.system.process import Interrupts
from balloon_warp.system.warp_threads import pick_device

if TYPE_CHECKING:
    from distributed import Client, Future


CONNECT_SECONDS = 10.0
"""Time within which a scheduler must answer [s]"""
WORKER_SECONDS = 30.0
"""Time within which a scheduler must have a worker [s]"""
ALONE_SECONDS = 60.0
"""Time after which ended workers are not waited for any more [s]: Dask may not have restarted them"""
# A large mesh travels with its share: a copy that lay on one worker would be lost with it.
SETTINGS = {"distributed.admin.large-graph-warning-threshold": "1 TiB"}
LOADING = """
from balloon_warp.system.process import without_garbage_collection
with without_garbage_collection():
    import {}
"""
"""Code by which a worker loads a module"""
_one_at_a_time = threading.Lock()  # a worker may have many threads, but it has one device


class DaskWorkers:
    """Workers of a scheduler, once there is one. See `Workers`.

    Raises:
        MissingExtraError: dask.distributed is not installed.
        InputError: no scheduler answers at the address, or it has no worker.
    """

    def __init__(self, cluster: WorkerOptions):
        try:
            import dask.config
            from distributed import Client
            from distributed.utils import silence_logging_cmgr
        except ImportError:
            raise MissingExtraError(
                f"{cluster.option} needs dask.distributed: pip install 'balloon-warp[cluster]'"
            ) from None
        self._option, self._prepare = cluster.option, cluster.prepare
        self._topic = f"balloon-warp-{uuid4().hex}"
        self._events: SimpleQueue[tuple[int, int | Future]] = SimpleQueue()  # a share, and its frame or its end
        self._sent = 0
        self._in_company = time.monotonic()
        with ExitStack() as stack:
            stack.enter_context(dask.config.set(SETTINGS))
            stack.enter_context(silence_logging_cmgr(logging.CRITICAL))
            self._client = stack.enter_context(_client(Client, str(cluster.address), self._option))
            self._stack = stack.pop_all()

    def devices(self, device: str | None, modules: Sequence[str]) -> list[str]:
        """See `Workers`. Dask's scheduler unpacks messages that pass through it, and loads the modules, too."""
        for module in modules:
            try:
                for run in (self._client.run_on_scheduler, self._client.run):
                    run(exec, LOADING.format(module))
            except ImportError as error:
                what = "Balloon Warp" if module.startswith("balloon_warp.") else f"{module}, which has a law"
                raise InputError(f"{self._option}: its scheduler or a worker cannot load {what}: {error}") from None
        names: Any = self._client.run(_device_name, device, self._prepare)
        self._client.subscribe_topic(self._topic, lambda event: self._events.put(event[1]))
        return list(names.values())

    def send(self, number: int, call: Call, full: Container[str]) -> None:
        """See `Workers`."""
        elsewhere: Any = {"workers": self._others(full), "allow_other_workers": True} if full else {}
        told = (call, self._prepare, self._topic, number)
        self._sent += 1
        future = self._client.submit(_do, *told, key=f"{self._topic}-{self._sent}", pure=False, **elsewhere)
        future.add_done_callback(lambda done: self._events.put((number, done)))

    def next(self, seconds: float) -> tuple[int, Any] | None:
        """See `Workers`."""
        try:
            number, news = self._events.get(timeout=seconds)
        except Empty:
            if _has_workers(self._client):
                self._in_company = time.monotonic()
            elif time.monotonic() - self._in_company > ALONE_SECONDS:
                raise _alone() from None
            return None
        self._in_company = time.monotonic()
        return number, news if isinstance(news, int) else _result(self._client, news)

    def have_room(self, full: Container[str]) -> bool:
        """See `Workers`."""
        return bool(self._others(full))

    def close(self) -> None:
        """Leave the workers, which others have started."""
        self._stack.close()

    def _others(self, full: Container[str]) -> list[str]:
        addresses: Any = self._client.nthreads()
        return [address for address in addresses if address not in full]


def _client(kind: type["Client"], address: str, option: str) -> "Client":
    """Return a client of a scheduler that has a worker.

    Raises:
        InputError: as `DaskWorkers`.
    """
    from distributed.utils import LoopRunner

    try:
        LoopRunner().run_sync(_identify, address)
        client = kind(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except OSError:
        raise InputError(
            f"{option}: no scheduler answered within {CONNECT_SECONDS:g} s; expected a running one"
        ) from None
    try:
        client.wait_for_workers(1, timeout=WORKER_SECONDS)
    except TimeoutError:
        client.close()
        raise InputError(
            f"{option}: the scheduler has no worker after {WORKER_SECONDS:g} s; start one for each GPU "
            f"with `dask worker {address} --nthreads 1`"
        ) from None
    return client


async def _identify(address: str) -> None:
    """Ask who is there: a client by itself would wait forever for the word of some other service."""
    import asyncio  # Dask has loaded it

    from distributed import rpc

    async with rpc(address) as scheduler:
        await asyncio.wait_for(scheduler.identity(), CONNECT_SECONDS)


def _alone() -> WorkersLostError:
    return WorkersLostError(f"all workers ended, and none came for {ALONE_SECONDS:g} s")


def _has_workers(client: "Client") -> bool:
    """Return whether there are any workers; a scheduler that is gone reports itself otherwise."""
    try:
        return bool(client.nthreads())
    except OSError:
        return True


def _result(client: "Client", future: "Future") -> Any:
    """Return the result of a share; it is computed again if its worker ends before the result is here."""
    from distributed.scheduler import KilledWorker

    seconds = ALONE_SECONDS
    try:
        while True:
            try:
                return future.result(timeout=seconds)
            except TimeoutError:
                if not _has_workers(client):
                    raise _alone() from None
                seconds *= 2.0  # it begins anew, and may be large
    except KilledWorker as error:
        raise WorkersLostError(f"a share of the batch crashed {error.allowed_failures + 1} workers in a row") from None
    except CancelledError:
        raise WorkersLostError("the scheduler is gone") from None


def _do(call: Call, prepare: Callable[[], object] | None, topic: str, number: int) -> Any:
    """Do a share on a worker."""
    from distributed import get_worker

    worker = get_worker()
    with _one_at_a_time:
        if prepare:
            prepare()
        return call.answer(worker.address, lambda frame: worker.log_event(topic, (number, frame)))


def _device_name(device: str | None, prepare: Callable[[], object] | None) -> str:
    """Name the device of a worker, on the worker."""
    if prepare:
        prepare()
    return str(pick_device(device))


LOOK_SECONDS = 0.5
"""Time after which the wait for workers is interrupted [s]"""
AHEAD = 2
"""Number of shares that are out, for each worker: one at work and one that follows; more would only fill the memory"""


class Work(NamedTuple):
    """Shares of work, and the function that does them."""

    do: Callable[..., Any]
    """Function of a share's arguments, and of `on_frame`, which takes the number of frames that are done"""
    shares: Mapping[int, tuple[Any, ...]]
    """Arguments by the numbers of shares: those that are still to be done"""
    weights: Sequence[float]
    """Fraction of the whole that each share is, those that are done already among them"""
    frames: int
    """Number of frames of each share"""


@contextmanager
def connect(cluster: WorkerOptions, module: str) -> Iterator[Workers]:
    """Connect to a scheduler's workers, or start some. Those that are started here end with the `with` block.

    Args:
        module: that does the work: workers load it as they start.

    Raises:
        MissingExtraError: dask.distributed is not installed, which a scheduler needs.
        InputError: no scheduler answers at the address, it has no worker, or this machine has fewer GPUs.
    """
    if cluster.address is None:
        from balloon_warp.farm.workers import LocalWorkers

        workers: Workers = LocalWorkers(cluster, module)
    else:
        workers = DaskWorkers(cluster)
    with closing(workers):
        yield workers


def require_laws_that_travel(laws: Sequence[Law], cluster: WorkerOptions) -> None:
    """Make sure that workers can be given laws.

    Raises:
        InputError: one is no global name.
    """
    for law in laws:
        try:
            pickle.dumps(law)
        except pickle.PicklingError as error:
            raise InputError(f"{cluster.option}: {error}") from None


def modules_of(laws: Sequence[Law]) -> list[str]:
    """Return the names of the modules in which laws are."""
    return [law.force.func.__module__ for law in laws]


def run_shares(
    workers: Workers,
    work: Work,
    worker_count: int,
    on_frame: Callable[[int], None],
    on_note: Callable[[str], None] = lambda sentence: None,
) -> Iterator[tuple[int, Any] | None]:
    """Do the shares, and yield each one's number and result as it comes, and nothing now and then meanwhile.

    The shares of a lost worker are done again. Where a share does not fit, other workers do it and all that follow.

    Args:
        on_frame: told how many frames are done, on the average of all shares by their weights.
        on_note: told of each worker that has no room.

    Raises:
        InputError: a share fits into no worker's memory, or workers do not start.
        BlowUpError: a world blew up, which is to stop all.
        WorkersLostError: a share lost one worker after the other, no worker is left, or the scheduler is gone.
    """
    missing = set(work.shares)
    waiting = iter(sorted(missing))
    full: dict[str, NoRoom] = {}  # workers that have no room, by their names
    refusals: Counter[int] = Counter()  # of shares

    def send(number: int) -> None:
        workers.send(number, Call(work.do, work.shares[number]), frozenset(full))

    def send_next() -> None:
        if (number := next(waiting, None)) is not None:
            send(number)

    for _ in range(AHEAD * worker_count):
        send_next()
    frames = np.array([0 if number in missing else work.frames for number in range(len(work.weights))])
    while missing:
        if (news := workers.next(LOOK_SECONDS)) is None:
            yield None
            continue
        number, told = news
        if isinstance(told, int):
            frames[number] = told
            yield None
        elif isinstance(told, NoRoom):
            if told.worker not in full:
                on_note(f"{told.device}: {told.reason}; the other workers do its share")
            full[told.worker] = told
            refusals[number] += 1
            if not workers.have_room(full) or refusals[number] > 2 * worker_count:
                raise NoRoomError(told.reason)
            send(number)
            continue
        else:
            frames[number] = work.frames
            missing.remove(number)
            send_next()
            yield number, told
        on_frame(int(frames @ np.array(work.weights) + 1.0e-6))


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


@dataclass(frozen=True)
class ShareOptions:
    """Options of the shares of a batch, the same for all."""

    chosen: NDArray[np.integer]
    """Worlds whose shape is wanted, by their numbers in the batch"""
    device: str | None
    """Warp device; the GPU, or else the CPU, if not given"""
    schedule: str
    """Parallel schedule: "scatter", "gather", "block", "lanes", "octets", or "auto" for the fastest"""
    world_count: int
    """Number of worlds of the whole batch"""
    on_blowup: str
    """Action after a blow-up, as in `run_batch`"""
    every: int = 0
    """Interval of recorded frames, as in `Recorder`"""


def simulate_share(share: Group, options: ShareOptions, on_frame: Callable[[int], None]) -> ShareResult:
    """Simulate a share from its start to its end.

    Args:
        on_frame: Called with the number of each simulated frame.

    Raises:
        InputError: there is no such device or schedule, or the share does not fit into its memory.
        BlowUpError: a world blew up, which is to stop all.
    """
    scene, chosen, every = share.plan.scene, options.chosen, options.every
    model = lay_out(share.plan, pick_device(options.device))
    settled = resolved_solver(options.schedule, model, options.world_count)
    require_batch_memory([model], [settled], [share], chosen, scene, scene.frames + 1, every)
    simulator = Simulator.of_model(model, settled)
    recorder = Recorder(simulator, share.rows_of(chosen), every)
    records: list[Record] = []
    for record in recorder.run():
        records.append(record)
        if options.on_blowup == "stop":
            require_health(simulator, share, record)
        on_frame(record.number)
    health = np.stack([record.healthy for record in records])
    failures, overflow = Failures(report_failures(simulator, share, health)), simulator.schedule.overflow
    remarks = remarks_on(simulator.model, simulator.state, share.worlds)
    del simulator, recorder  # restarted worlds reuse their memory
    if options.on_blowup == "restart":
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
    options = ShareOptions(task.chosen, device, task.schedule, task.world_count, task.on_blowup, task.every)
    return Work(
        simulate_share,
        {number: (share, options) for number, share in enumerate(shares) if number not in done},
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

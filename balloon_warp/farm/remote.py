"""Shares of work on workers, of this machine or of a running Dask scheduler: results come back in any order."""

import logging
import pickle
import threading
import time
from collections import Counter
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, closing, contextmanager
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, NamedTuple
from uuid import uuid4

import numpy as np

from balloon_warp.errors import InputError, MissingExtraError, NoRoomError, WorkersLostError
from balloon_warp.farm.workers import Call, NoRoom, WorkerOptions, Workers
from balloon_warp.kernels.laws import Law
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
from balloon_warp.system.loading import without_garbage_collection
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
        from balloon_warp.farm.local_workers import LocalWorkers

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

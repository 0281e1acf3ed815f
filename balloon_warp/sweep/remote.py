"""Shares of work on Dask's workers: they go out, and their results come back in any order."""

import os
import pickle
import threading
import time
from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, NamedTuple
from uuid import uuid4

import numpy as np

from balloon_warp.device import pick_device
from balloon_warp.errors import InputError, NoRoomError, WorkersLostError
from balloon_warp.kernels.laws import Law
from balloon_warp.sweep.cluster import Cluster

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


class NoRoom(NamedTuple):
    """Answer of a worker into whose memory a share does not fit."""

    address: str
    device: str
    """Name of its GPU in the machine, or else its address"""
    reason: str


class Work(NamedTuple):
    """Shares of work, and what does them."""

    do: Callable[..., Any]
    """Function of a share's arguments, and of `on_frame`, which takes the number of frames that are done"""
    shares: Mapping[int, tuple[Any, ...]]
    """Arguments by the numbers of shares: those that are still to be done"""
    weights: Sequence[float]
    """Fraction of the whole that each share is, those that are done already among them"""
    frames: int
    """Number of frames of each share"""


def require_laws_that_travel(laws: Sequence[Law], cluster: Cluster) -> None:
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


def worker_devices(client: "Client", cluster: Cluster, device: str | None, modules: Iterable[str]) -> list[str]:
    """Return the device of each worker, such as "cpu" or "cuda:0", once it has loaded modules.

    Args:
        modules: that work needs: of Balloon Warp, or of laws of one's own.

    Raises:
        InputError: a worker has no such device; or it, or the scheduler, has no Balloon Warp, or not the module of a
            law.
    """
    for module in modules:
        try:
            for run in (client.run_on_scheduler, client.run):  # Dask's scheduler opens what passes through it
                run(exec, LOADING.format(module))
        except ImportError as error:
            what = "Balloon Warp" if module.startswith("balloon_warp.") else f"{module}, which has a law"
            raise InputError(f"{cluster.option}: its scheduler or a worker cannot load {what}: {error}") from None
    names: Any = client.run(_device_name, device, cluster.prepare)
    return list(names.values())


def run_shares(
    client: "Client",
    cluster: Cluster,
    work: Work,
    worker_count: int,
    on_frame: Callable[[int], None],
    on_note: Callable[[str], None] = lambda sentence: None,
) -> Iterator[tuple[int, Any] | None]:
    """Do the shares, and yield each one's number and result as it comes, and nothing now and then meanwhile.

    What a lost worker had is done again. Where a share does not fit, other workers do it and all that follow.

    Args:
        on_frame: told how many frames are done, on the average of all shares by their weights.
        on_note: told of each worker that has no room.

    Raises:
        InputError: a share fits into no worker's memory.
        BlowUpError: a world blew up, which is to stop all.
        WorkersLostError: a share lost one worker after the other, no worker is left, or the scheduler is gone.
    """
    topic = f"balloon-warp-{uuid4().hex}"
    events: SimpleQueue[tuple[int, int | Future]] = SimpleQueue()  # a share, and its frame or its end
    client.subscribe_topic(topic, lambda event: events.put(event[1]))
    missing = set(work.shares)
    waiting = iter(sorted(missing))
    full: dict[str, NoRoom] = {}  # workers that have no room, by their addresses
    refusals: Counter[int] = Counter()  # of shares

    def send(number: int) -> None:
        told = (work.do, work.shares[number], cluster.prepare, topic, number)
        elsewhere: Any = {"workers": _others(client, full), "allow_other_workers": True} if full else {}
        future = client.submit(_do, *told, key=f"{topic}-{number}-{refusals[number]}", pure=False, **elsewhere)
        future.add_done_callback(lambda done: events.put((number, done)))

    def send_next() -> None:
        if (number := next(waiting, None)) is not None:
            send(number)

    for _ in range(AHEAD * worker_count):
        send_next()
    frames = np.array([0 if number in missing else work.frames for number in range(len(work.weights))])
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
            if isinstance(result, NoRoom):
                if result.address not in full:
                    on_note(f"{result.device}: {result.reason}; the other workers do its share")
                full[result.address] = result
                refusals[number] += 1
                if not _others(client, full) or refusals[number] > 2 * worker_count:
                    raise NoRoomError(result.reason)
                send(number)
                continue
            frames[number] = work.frames
            missing.remove(number)
            send_next()
            yield number, result
        on_frame(int(frames @ np.array(work.weights) + 1.0e-6))


def _others(client: "Client", full: Container[str]) -> list[str]:
    """Return the addresses of the workers that have room as far as is known."""
    addresses: Any = client.nthreads()
    return [address for address in addresses if address not in full]


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
                    raise WorkersLostError(f"all workers ended, and none came for {ALONE_SECONDS:g} s") from None
                seconds *= 2.0  # it begins anew, and may be large
    except KilledWorker as error:
        raise WorkersLostError(f"a share of the batch crashed {error.allowed_failures + 1} workers in a row") from None
    except CancelledError:
        raise WorkersLostError("the scheduler is gone") from None


def _do(
    do: Callable[..., Any], share: tuple[Any, ...], prepare: Callable[[], None] | None, topic: str, number: int
) -> Any:
    """Do a share on a worker."""
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
        try:
            return do(*share, on_frame=report)
        except NoRoomError as error:
            names = os.environ.get("CUDA_VISIBLE_DEVICES")
            return NoRoom(worker.address, f"GPU {names}" if names else worker.address, str(error))


def _device_name(device: str | None, prepare: Callable[[], None] | None) -> str:
    """Name the device of a worker, on the worker."""
    if prepare:
        prepare()
    return str(pick_device(device))

"""Processes and a thread as workers: the thread has the first GPU of this machine, each process another, or the CPU."""

import threading
from collections import Counter, deque
from collections.abc import Container, Iterable, Mapping, Sequence
from multiprocessing import Pipe
from multiprocessing.connection import wait
from queue import Empty, SimpleQueue
from typing import Any

from balloon_warp.errors import InputError, WorkersLostError
from balloon_warp.sweep.child import UNGUARDED, end_children, pack
from balloon_warp.sweep.cluster import Cluster, worker_environments
from balloon_warp.sweep.local_worker import InProcess, InThread, Served, Share
from balloon_warp.sweep.workers import Call

MOST_LOSSES = 3
"""Number of workers that a share may cost without being given up"""


class LocalWorkers:
    """Processes that are at work as soon as they have started, and this one from the beginning. See `Workers`.

    A thread hands out shares and takes results in. A process that ends is started again.

    Args:
        cluster: number of GPUs or processes. The first of several GPUs, and a single one, is this process's own.
        module: that work needs; loaded by processes as they start.

    Raises:
        InputError: this machine has fewer GPUs, or a process cannot be started.
    """

    def __init__(self, cluster: Cluster, module: str):
        self._option, self._device = cluster.option, str(cluster.device(None))
        self._served = Served(self._device, module, cluster.prepare)
        self._pending: deque[Share] = deque()
        self._events: SimpleQueue[tuple[int, Any]] = SimpleQueue()
        self._losses: Counter[int] = Counter()
        self._closed = False
        self._started = threading.Event()
        """Whether a worker has started, or none will"""
        self._failure: BaseException | None = None
        self._ear, self._bell = Pipe(duplex=False)
        self._environments = {str(number): each for number, each in enumerate(worker_environments(cluster))}
        """Environments of all workers, by their names"""
        self._workers: list[InProcess | InThread] = []
        """Workers that have been started"""
        self._lock = threading.Lock()
        processes = dict(self._environments)
        if cluster.gpus is not None:
            processes.pop(first := next(iter(processes)))
            self._workers.append(InThread(self._served, first, self._ring))
        self._thread = threading.Thread(target=self._hand_out_and_listen, daemon=True, name="shares")
        self._thread.start()
        threading.Thread(target=self._start_processes, args=(processes,), daemon=True, name="starts").start()

    def devices(self, device: str | None, modules: Sequence[str]) -> list[str]:
        """Return the device of each, once one has started; they have the modules of this process."""
        self._started.wait()
        if self._failure:
            raise self._failure
        return [self._device] * len(self._environments)

    def send(self, number: int, call: Call, full: Container[str]) -> None:
        """See `Workers`."""
        self._pending.append(Share(number, pack(call), full))
        self._ring()

    def next(self, seconds: float) -> tuple[int, Any] | None:
        """See `Workers`."""
        try:
            number, told = self._events.get(timeout=seconds)
        except Empty:
            return None
        if isinstance(told, BaseException):
            raise told
        return number, told

    def have_room(self, full: Container[str]) -> bool:
        """See `Workers`."""
        return any(name not in full for name in self._environments)

    def close(self) -> None:
        """See `Workers`."""
        if self._closed:
            return
        with self._lock:
            self._closed = True
        end_children([worker.process for worker in self._workers if isinstance(worker, InProcess)], 0.0)
        self._ring()
        self._thread.join()
        for worker in self._workers:
            worker.close()

    def _ring(self) -> None:
        """Wake the thread that hands out shares."""
        self._bell.send_bytes(b".")

    def _start_processes(self, environments: Mapping[str, Mapping[str, str]]) -> None:
        """Start processes, which takes seconds where their fork server still loads."""
        try:
            for name, environment in environments.items():
                if self._closed:
                    return
                self._join(InProcess(self._served, name, environment))
        except BaseException as failure:
            self._fail(failure)

    def _join(self, worker: InProcess) -> None:
        """Let a process take shares, or end it, where all is over."""
        with self._lock:
            if not self._closed:
                self._workers = [*self._workers, worker]
                self._ring()
                return
        end_children([worker.process], 0.0)
        worker.close()

    def _hand_out_and_listen(self) -> None:
        try:
            while not self._closed:
                self._hand_out()
                connections = {worker.connection: worker for worker in self._workers if isinstance(worker, InProcess)}
                for ready in wait([self._ear, *connections]):
                    if ready is self._ear:
                        self._ear.recv_bytes()
                        for worker in self._workers:
                            self._take(worker, worker.told_here() if isinstance(worker, InThread) else ())
                    else:
                        self._listen(connections[ready])  # pyright: ignore[reportArgumentType]
        except BaseException as failure:
            self._fail(failure)

    def _hand_out(self) -> None:
        """Give each free worker the first share that it may have."""
        for worker in self._workers:
            if not worker.free:
                continue
            for share in list(self._pending):
                if worker.name not in share.full:
                    self._pending.remove(share)
                    worker.free, worker.shares[share.number] = False, share
                    worker.give(share)
                    break

    def _listen(self, worker: InProcess) -> None:
        try:
            told = worker.connection.recv()
        except (EOFError, OSError):
            if not self._closed:
                self._replace(worker)
            return
        self._take(worker, [told])

    def _take(self, worker: InProcess | InThread, news: Iterable[tuple[int | None, Any]]) -> None:
        """Take in a worker's messages, as `Line` describes them."""
        for number, told in news:
            if number is None:
                worker.free = worker.ready = True
                self._started.set()
            elif number < 0:
                self._fail(told)
            else:
                if not isinstance(told, int):
                    worker.shares.pop(number)
                self._events.put((number, told))

    def _fail(self, failure: BaseException) -> None:
        self._failure = self._failure or failure
        self._events.put((-1, self._failure))
        self._started.set()

    def _replace(self, lost: InProcess) -> None:
        """Start a worker again that has ended, and have others do its shares."""
        end_children([lost.process], 1.0)
        if not lost.ready:
            if (lost.process.exitcode or 0) >= 0:
                raise InputError(f"{self._option}: the workers do not start; {UNGUARDED.replace('processes', 'them')}")
            self._lose(-1)
        for number, share in lost.shares.items():
            self._lose(number)
            self._pending.appendleft(share)
        lost.connection.close()
        with self._lock:
            self._workers = [worker for worker in self._workers if worker is not lost]
        self._join(InProcess(self._served, lost.name, lost.environment))

    def _lose(self, number: int) -> None:
        """Count a worker that a share has cost, or, of number -1, the start."""
        self._losses[number] += 1
        if self._losses[number] > MOST_LOSSES:
            raise WorkersLostError(f"a share of the batch crashed {MOST_LOSSES + 1} workers in a row")

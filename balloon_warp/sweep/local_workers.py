"""Processes and a thread as workers: the thread has the first GPU of this machine, each process another, or the CPU."""

import pickle
import threading
from collections import Counter, deque
from collections.abc import Callable, Container, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from importlib import import_module
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from queue import Empty, SimpleQueue
from typing import Any

from balloon_warp.device import pick_device
from balloon_warp.errors import InputError, WorkersLostError
from balloon_warp.garbage import without_collecting
from balloon_warp.sweep.child import UNGUARDED, as_sent, end_children, pack, start_child
from balloon_warp.sweep.cluster import Cluster, worker_environments
from balloon_warp.sweep.workers import Call

MOST_LOSSES = 3
"""Number of workers that a share may cost without being given up"""
ENDING_SECONDS = 10.0
"""Time in which a share that is at work in this process must end [s]: it ends after its frame"""


class LocalWorkers:
    """Processes that are at work as soon as they have started, and this one from the beginning. See `Workers`.

    A thread hands out shares and takes results in. A process that ends is started again.

    Args:
        cluster: number of GPUs or processes. The first of several GPUs, and a single one, is this process's own.
        module: what work needs; loaded by processes as they start.

    Raises:
        InputError: this machine has fewer GPUs, or a process cannot be started.
    """

    def __init__(self, cluster: Cluster, module: str):
        self._option, self._device = cluster.option, str(cluster.device(None))
        self._told = self._device, module, cluster.prepare
        self._pending: deque[tuple[int, bytes, Container[str]]] = deque()
        self._events: SimpleQueue[tuple[int, Any]] = SimpleQueue()
        self._losses: Counter[int] = Counter()
        self._closed = False
        self._started = threading.Event()
        """Whether a worker has started, or none will"""
        self._failure: BaseException | None = None
        self._ear, self._bell = Pipe(duplex=False)
        self._members: list[_Member] = []
        try:
            for number, environment in reversed(list(enumerate(worker_environments(cluster)))):
                here = number == 0 and cluster.gpus is not None
                self._members.insert(0, _Member(str(number), environment, self._told, here))
        except BaseException:
            self.close()
            raise
        self._thread = threading.Thread(target=self._hand_out_and_listen, daemon=True, name="shares")
        self._thread.start()

    def devices(self, device: str | None, modules: Sequence[str]) -> list[str]:
        """Return the device of each, once one has started; they have the modules of this process."""
        self._started.wait()
        if self._failure:
            raise self._failure
        return [self._device] * len(self._members)

    def send(self, number: int, call: Call, full: Container[str]) -> None:
        """See `Workers`."""
        self._pending.append((number, pack(call), full))
        self._bell.send_bytes(b".")

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
        return any(member.name not in full for member in self._members)

    def close(self) -> None:
        """See `Workers`."""
        if self._closed:
            return
        self._closed = True
        end_children([member.process for member in self._members if member.process], 0.0)
        if hasattr(self, "_thread"):
            self._bell.send_bytes(b".")
            self._thread.join()
        for member in self._members:
            member.connection.close()
            if member.thread:
                member.thread.join(ENDING_SECONDS)

    def _hand_out_and_listen(self) -> None:
        try:
            while not self._closed:
                self._hand_out()
                by_connection = {member.connection: member for member in self._members}
                for ready in wait([self._ear, *by_connection]):
                    if ready is self._ear:
                        self._ear.recv_bytes()
                    else:
                        self._listen(by_connection[ready])  # pyright: ignore[reportArgumentType]
        except BaseException as failure:
            self._fail(failure)

    def _hand_out(self) -> None:
        """Give each free worker the first share that it may have."""
        for member in self._members:
            if not member.free:
                continue
            for share in list(self._pending):
                if member.name not in share[2]:
                    self._pending.remove(share)
                    member.give(share)
                    break

    def _listen(self, member: "_Member") -> None:
        try:
            number, told = member.connection.recv()
        except (EOFError, OSError):
            if not self._closed:
                self._replace(member)
            return
        if number is None:
            member.free = member.ready = True
            self._started.set()
            return
        if number < 0:
            self._fail(told)
            return
        if not isinstance(told, int):
            member.shares.pop(number)
        self._events.put((number, told))

    def _fail(self, failure: BaseException) -> None:
        self._failure = self._failure or failure
        self._events.put((-1, self._failure))
        self._started.set()

    def _replace(self, lost: "_Member") -> None:
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
        self._members[self._members.index(lost)] = _Member(lost.name, lost.environment, self._told, here=False)

    def _lose(self, number: int) -> None:
        """Count a worker that a share has cost, or, of number -1, the start."""
        self._losses[number] += 1
        if self._losses[number] > MOST_LOSSES:
            raise WorkersLostError(f"a share of the batch crashed {MOST_LOSSES + 1} workers in a row")


class _Member:
    """Worker, and what it has in hand.

    Args:
        told: of `_serve`, besides the connection and the name.
        here: whether it is a thread of this process.
    """

    def __init__(self, name: str, environment: Mapping[str, str], told: tuple[Any, ...], here: bool):
        self.name, self.environment = name, environment
        self.shares: dict[int, tuple[int, bytes, Container[str]]] = {}
        """Shares whose results are not here, by their numbers"""
        self.free = self.ready = False
        self.process: Any = None
        self.thread: threading.Thread | None = None
        if here:
            self.connection, far = Pipe()
            device, module, _ = told
            given = far, name, device, module
            self.thread = threading.Thread(target=_serve, args=given, daemon=True, name="first GPU")
            self.thread.start()
        else:
            self.process, self.connection = start_child(_serve, environment, name, *told)

    def give(self, share: tuple[int, bytes, Container[str]]) -> None:
        self.free, self.shares[share[0]] = False, share
        try:
            self.connection.send_bytes(pickle.dumps(share[0]))
            self.connection.send_bytes(share[1])
        except OSError:  # it has ended, as its connection tells next
            return


class _Line:
    """End of a worker's connection: results go out while it does the next share."""

    def __init__(self, connection: Connection):
        self._connection, self._busy = connection, threading.Lock()
        self._sender = ThreadPoolExecutor(max_workers=1)
        self._last: Future[None] | None = None

    def tell(self, number: int | None, told: Any) -> None:
        with self._busy:
            self._connection.send((number, told))

    def tell_frame(self, number: int, frame: int) -> None:
        """Tell of a frame, unless a result goes out."""
        if self._busy.acquire(blocking=False):
            try:
                self._connection.send((number, frame))
            finally:
                self._busy.release()

    def tell_later(self, number: int, told: Any) -> None:
        """Tell in the background, once the last that was told so is out."""
        if self._last:
            self._last.result()
        self._last = self._sender.submit(self.tell, number, told)


def _serve(
    connection: Connection, name: str, device: str, module: str, prepare: Callable[[], None] | None = None
) -> None:
    """Do shares until the connection's other end is closed."""
    line = _Line(connection)
    try:
        if prepare:
            prepare()
        with without_collecting():
            import_module(module)
        pick_device(device)
        line.tell(None, None)
        while True:
            number = pickle.loads(connection.recv_bytes())
            packed = connection.recv_bytes()
            try:
                call: Call = pickle.loads(packed)
                told = call.answer(name, lambda frame, number=number: line.tell_frame(number, frame))
            except (BrokenPipeError, ConnectionResetError):
                raise
            except Exception as failure:
                told = as_sent(failure)
            line.tell(None, None)
            line.tell_later(number, told)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return
    except Exception as failure:
        line.tell(-1, as_sent(failure))

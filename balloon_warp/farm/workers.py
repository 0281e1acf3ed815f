"""Workers: their number and protocol, and those that are processes and threads of this machine."""

import multiprocessing
import os
import pickle
import re
import signal
import sys
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from balloon_warp.errors import InputError, NoRoomError, WorkersLostError
from balloon_warp.system.api import check_fields
from balloon_warp.system.process import without_garbage_collection
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.system.warp_threads import pick_device

if TYPE_CHECKING:
    pass
EXAMPLE = "tcp://192.168.0.1:8786"


@dataclass(frozen=True)
class WorkerOptions:
    """Workers to start or to connect to: one of `address`, `gpus` and `workers` is given.

    Raises:
        InputError: none or several are, the address is none, or a number is below 1.
    """

    address: str | None = None
    """Address of a running scheduler, such as `EXAMPLE`"""
    gpus: int | None = None
    """Number of GPUs of this machine, a worker each"""
    workers: int | None = None
    """Number of processes on this machine's CPU"""
    prepare: Callable[[], object] | None = None
    """Function called in each worker before anything else, for instance to set up Warp's messages"""

    def __post_init__(self) -> None:
        check_fields(self)
        if sum(choice is not None for choice in (self.address, self.gpus, self.workers)) != 1:
            raise InputError("cluster, gpus, workers: expected only one of them")
        if self.address is not None and not re.fullmatch(r"(tcp|tls)://[^/]+:\d+", self.address):
            raise InputError(f"cluster {self.address}: expected an address such as {EXAMPLE}")
        for option, count in (("gpus", self.gpus), ("workers", self.workers)):
            if count is not None and count < 1:
                raise InputError(f"{option} {count}: expected at least 1")

    @property
    def option(self) -> str:
        """The argument that asks for these workers, and its value."""
        if self.address is not None:
            return f"cluster {self.address}"
        return f"gpus {self.gpus}" if self.gpus else f"workers {self.workers}"

    def device(self, asked: str | None) -> str | None:
        """Return the device of each worker.

        Raises:
            InputError: a device is asked for besides this machine's GPUs or CPU.
        """
        if self.address is not None:
            return asked
        if asked:
            raise InputError(f"device {asked}: needs a cluster; gpus and workers choose the device themselves")
        return "cuda:0" if self.gpus else "cpu"


def worker_environments(cluster: WorkerOptions) -> list[dict[str, str]]:
    """Return the environment of each worker to start: the GPU that it sees.

    Raises:
        InputError: this machine has fewer GPUs, or the same one is named twice.
    """
    if not cluster.gpus:
        return [{}] * (cluster.workers or 0)
    import warp as wp

    quiet_warp()
    visible = os.environ.get("CUDA_VISIBLE_DEVICES")
    chosen = visible.split(",") if visible else []
    if len(set(chosen)) < len(chosen):
        raise InputError(f"CUDA_VISIBLE_DEVICES={visible}: names a GPU twice")
    if cluster.gpus > (present := wp.get_cuda_device_count()):
        raise InputError(f"{cluster.option}: this machine has {present}")
    names = chosen or [str(number) for number in range(present)]
    return [{"CUDA_VISIBLE_DEVICES": name} for name in names[: cluster.gpus]]


REPORT_SECONDS = 0.1
"""Time between two reports of a worker on its current frame [s]"""


class NoRoom(NamedTuple):
    """Answer of a worker into whose memory a share does not fit."""

    worker: str
    device: str
    """Name of its GPU in the machine, or else of the worker"""
    reason: str


class Call(NamedTuple):
    """Share of work as a worker gets it."""

    do: Callable[..., Any]
    """Function of a share's arguments, and of `on_frame`, which takes the number of frames that are done"""
    arguments: tuple[Any, ...]

    def answer(self, worker: str, tell: Callable[[int], None]) -> Any:
        """Do the share, on the worker of that name, and tell of frames now and then; return its result or `NoRoom`."""
        last = time.monotonic()

        def report(frame: int) -> None:
            nonlocal last
            if (now := time.monotonic()) - last > REPORT_SECONDS:
                tell(frame)
                last = now

        try:
            return self.do(*self.arguments, on_frame=report)
        except NoRoomError as error:
            names = os.environ.get("CUDA_VISIBLE_DEVICES")
            return NoRoom(worker, f"GPU {names}" if names and "," not in names else worker, str(error))


class Workers(Protocol):
    """Workers that do shares; the share of a lost one is done again by another."""

    def devices(self, device: str | None, modules: Sequence[str]) -> list[str]:
        """Return the device of each worker, such as "cpu" or "cuda:0".

        Args:
            modules: that work needs: of Balloon Warp, or of laws of one's own.

        Raises:
            InputError: a worker has no such device, or it has no Balloon Warp, or not the module of a law.
        """
        ...

    def send(self, number: int, call: Call, full: Container[str]) -> None:
        """Give a share to a worker, if possible none of those that are full."""
        ...

    def next(self, seconds: float) -> tuple[int, Any] | None:
        """Return news of a share: its number, and its current frame or its result; nothing if none comes in time.

        Raises:
            InputError: workers do not start.
            WorkersLostError: a share lost one worker after the other, no worker is left, or a scheduler is gone.
            Exception: as raised by a share.
        """
        ...

    def have_room(self, full: Container[str]) -> bool:
        """Return whether there is a worker besides those that are full."""
        ...

    def close(self) -> None:
        """End the workers that were started here."""
        ...


LOADED = ["balloon_warp.farm.cluster"]
"""Modules that a fork server loads: nearly all that any child needs"""
SAFE_PATH = "PYTHONSAFEPATH"
"""Variable that keeps Python from importing modules of the current folder"""
CHILD_SECONDS = 1.0
"""Time that processes have to end by themselves [s]"""
UNGUARDED = 'a script that starts processes needs its main part under `if __name__ == "__main__":`'
UNSENT = (pickle.PicklingError, AttributeError, TypeError)
"""Errors of objects that cannot be sent"""


def begin_children() -> None:
    """Start the fork server, where the system has any, if it does not run: it loads while its caller goes on.

    Children that it forks start in a tenth of the time that loading takes. It ends with this process.
    """
    if sys.platform == "win32":
        return
    from multiprocessing import resource_tracker
    from multiprocessing.forkserver import ensure_running, set_forkserver_preload

    set_forkserver_preload(LOADED)
    resource_tracker.ensure_running()  # lets Ctrl-C through again, so not meanwhile
    with _unlike_a_script():
        ensure_running()


@contextmanager
def _unlike_a_script() -> Iterator[None]:
    """Keep a process that starts meanwhile from Ctrl-C, which is for its parent, and from modules of this folder."""
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        os.environ.pop(SAFE_PATH)
        if before is not None:
            os.environ[SAFE_PATH] = before


def start_child(serve: Callable[..., None], environment: Mapping[str, str], *given: Any) -> tuple[Any, Connection]:
    """Start a process that calls a function of a connection and given arguments; return it and the other end.

    Args:
        environment: variables that it has besides those of this process.

    Raises:
        InputError: the process does not start.
        PicklingError, AttributeError, TypeError: something cannot be sent to it.
    """
    begin_children()
    context: Any = multiprocessing.get_context("spawn" if sys.platform == "win32" else "forkserver")
    near, far = context.Pipe()
    everything = {**os.environ, **environment}  # a fork server has those of the moment in which it started
    process = context.Process(target=_begin, args=(serve, everything, far, *given), daemon=True)
    try:
        process.start()
    except RuntimeError:
        raise InputError(f"the processes do not start; {UNGUARDED}") from None
    far.close()
    return process, near


def end_children(processes: Iterable[Any], seconds: float = CHILD_SECONDS) -> None:
    """End processes, and those by force that have not ended by themselves in some time [s]."""
    started = [process for process in processes if process.pid is not None]
    until = time.monotonic() + seconds
    for process in started:
        process.join(max(until - time.monotonic(), 0.0))
    for process in started:
        process.kill()
    for process in started:
        process.join()


def pack(what: Any) -> bytes:
    """Return bytes that `pickle.loads` unpacks in another process; cloudpickle, if installed, packs functions.

    Raises:
        PicklingError, AttributeError, TypeError: it cannot be sent.
    """
    try:
        return pickle.dumps(what, protocol=pickle.HIGHEST_PROTOCOL)
    except UNSENT:
        if not find_spec("cloudpickle"):
            raise
        from cloudpickle import dumps  # comes with extras

        return dumps(what)


def as_sent(failure: Exception) -> Exception:
    """Return a failure, or its words where it cannot be sent."""
    try:
        pickle.loads(pickle.dumps(failure))
    except Exception:
        return WorkersLostError(f"{type(failure).__name__}: {failure}")
    return failure


def _begin(serve: Callable[..., None], environment: Mapping[str, str], connection: Connection, *given: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to all, and it is for the first process
    os.environ.clear()
    os.environ.update(environment)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    serve(connection, *given)


def _end_with_parent() -> None:
    """End the process, even within a function, as soon as its parent is gone."""
    parent = multiprocessing.parent_process()
    if parent:
        parent.join()
        os._exit(1)


ENDING_SECONDS = 10.0
"""Time in which a share that is at work in a thread must end [s]"""


class Share(NamedTuple):
    """Share of work to hand out."""

    number: int
    call: bytes
    """`Call`, as `pack` sends it"""
    full: Container[str]
    """Names of workers that are not to have it"""


class Served(NamedTuple):
    """Needs of a worker before its first share."""

    device: str
    module: str
    """Module that the work needs"""
    prepare: Callable[[], object] | None
    """Function that a process calls before anything else"""


class Line(Protocol):
    """A worker's end of a connection, on which it sends tuples: the number of a share, and news of it.

    That is a frame or the result; None for both is told by a worker that is free; -1 is the number of a failure of the
    worker itself.
    """

    def receive(self) -> tuple[int, bytes]:
        """Wait for a share.

        Raises:
            EOFError: there are no more.
        """
        ...

    def tell(self, number: int | None, told: Any) -> None: ...

    def tell_frame(self, number: int, frame: int) -> None:
        """Tell of a frame, unless a result goes out."""
        ...

    def tell_result(self, number: int, told: Any) -> None:
        """Tell of a result, in the background."""
        ...


class InProcess:
    """Worker in a process of its own, and its shares in hand.

    Args:
        environment: variables of the process besides those of this one.
    """

    def __init__(self, served: Served, name: str, environment: Mapping[str, str]):
        self.name, self.environment = name, environment
        self.shares: dict[int, Share] = {}
        """Shares whose results are not here, by their numbers"""
        self.free = self.ready = False
        self.process, self.connection = start_child(_serve_through, environment, name, served)

    def give(self, share: Share) -> None:
        """Send a share to it."""
        try:
            self.connection.send_bytes(pickle.dumps(share.number))
            self.connection.send_bytes(share.call)
        except OSError:  # it has ended, as its connection tells next
            return

    def close(self) -> None:
        """Close the connection."""
        self.connection.close()


class InThread:
    """Worker in a thread of this process, and its shares in hand: results go from hand to hand.

    Args:
        ring: called where there is something to hear.
    """

    def __init__(self, served: Served, name: str, ring: Callable[[], None]):
        self.name = name
        self.shares: dict[int, Share] = {}
        """Shares whose results are not here, by their numbers"""
        self.free = self.ready = False
        self._line = _Queues(ring)
        as_here = served._replace(prepare=None)
        self._thread = threading.Thread(target=_serve, args=(self._line, name, as_here), daemon=True, name="first GPU")
        self._thread.start()

    def give(self, share: Share) -> None:
        """Hand a share to it."""
        self._line.given.put((share.number, share.call))

    def messages_here(self) -> Iterator[tuple[int | None, Any]]:
        """Iterate over the thread's messages since."""
        while True:
            try:
                yield self._line.told.get_nowait()
            except Empty:
                return

    def close(self) -> None:
        """Stop the thread after the frame that it simulates."""
        self._line.closed = True
        self._line.given.put(None)
        self._thread.join(ENDING_SECONDS)


class _Queues:
    """Line of a thread, through queues."""

    def __init__(self, ring: Callable[[], None]):
        self.given: SimpleQueue[tuple[int, bytes] | None] = SimpleQueue()
        self.told: SimpleQueue[tuple[int | None, Any]] = SimpleQueue()
        self.closed = False
        self._ring = ring

    def receive(self) -> tuple[int, bytes]:
        share = self.given.get()
        if self.closed or share is None:
            raise EOFError
        return share

    def tell(self, number: int | None, told: Any) -> None:
        if self.closed:
            raise BrokenPipeError
        self.told.put((number, told))
        self._ring()

    tell_frame = tell_result = tell


class _Pipe:
    """Line of a process, through a pipe."""

    def __init__(self, connection: Connection):
        self._connection, self._busy = connection, threading.Lock()
        self._sender = ThreadPoolExecutor(max_workers=1)
        self._last: Future[None] | None = None

    def receive(self) -> tuple[int, bytes]:
        return pickle.loads(self._connection.recv_bytes()), self._connection.recv_bytes()

    def tell(self, number: int | None, told: Any) -> None:
        with self._busy:
            self._connection.send((number, told))

    def tell_frame(self, number: int, frame: int) -> None:
        if self._busy.acquire(blocking=False):
            try:
                self._connection.send((number, frame))
            finally:
                self._busy.release()

    def tell_result(self, number: int, told: Any) -> None:
        if self._last:
            self._last.result()
        self._last = self._sender.submit(self.tell, number, told)


def _serve_through(connection: Connection, name: str, served: Served) -> None:
    _serve(_Pipe(connection), name, served)


def _serve(line: Line, name: str, served: Served) -> None:
    """Do shares until there are no more."""
    try:
        if served.prepare:
            served.prepare()
        with without_garbage_collection():
            import_module(served.module)
        pick_device(served.device)
        line.tell(None, None)
        while True:
            number, packed = line.receive()
            try:
                call: Call = pickle.loads(packed)
                told = call.answer(name, lambda frame, number=number: line.tell_frame(number, frame))
            except (BrokenPipeError, ConnectionResetError):
                raise
            except Exception as failure:
                told = as_sent(failure)
            line.tell(None, None)
            line.tell_result(number, told)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return
    except Exception as failure:
        line.tell(-1, as_sent(failure))


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

    def __init__(self, cluster: WorkerOptions, module: str):
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
                            self._take(worker, worker.messages_here() if isinstance(worker, InThread) else ())
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

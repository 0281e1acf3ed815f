"""Worker processes and worker threads: loops over shares, until they are closed."""

import pickle
import threading
from collections.abc import Callable, Container, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from importlib import import_module
from multiprocessing.connection import Connection
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple, Protocol

from balloon_warp.device import pick_device
from balloon_warp.garbage import without_collecting
from balloon_warp.sweep.child import as_sent, start_child
from balloon_warp.sweep.workers import Call

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

    def told_here(self) -> Iterator[tuple[int | None, Any]]:
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
        with without_collecting():
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

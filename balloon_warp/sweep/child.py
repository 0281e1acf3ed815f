"""Child processes: each serves its parent, and ends with it."""

import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from multiprocessing.connection import Connection
from typing import Any

from balloon_warp.errors import InputError, WorkersLostError

LOADED = ["balloon_warp.sweep.shares"]
"""Modules that a fork server loads: nearly all that any child needs"""
SAFE_PATH = "PYTHONSAFEPATH"
"""Variable that keeps Python from importing modules of the current folder"""
ENDING_SECONDS = 1.0
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


def end_children(processes: Iterable[Any], seconds: float = ENDING_SECONDS) -> None:
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

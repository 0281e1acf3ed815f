"""Shares of work on workers: they go out, and their results come back in any order."""

import pickle
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from typing import Any, NamedTuple

import numpy as np

from balloon_warp.errors import InputError, NoRoomError
from balloon_warp.kernels.laws import Law
from balloon_warp.sweep.options import WorkerOptions
from balloon_warp.sweep.workers import Call, NoRoom, Workers

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
        from balloon_warp.sweep.local_workers import LocalWorkers

        workers: Workers = LocalWorkers(cluster, module)
    else:
        from balloon_warp.sweep.dask_workers import DaskWorkers

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

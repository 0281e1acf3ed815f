"""Helpers of the tests of clusters."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from commands import status_of
from meshes import quad_sphere

from balloon_warp.mesh.obj import write_obj


@contextmanager
def start_workers(count: int) -> Iterator[Any]:
    """Start a scheduler and workers, as users do for several machines; a worker that dies is replaced by its nanny."""
    from distributed import Nanny, Scheduler, SpecCluster
    from distributed.utils import silence_logging_cmgr

    common: dict[str, Any] = {"host": "127.0.0.1", "dashboard": False, "dashboard_address": "127.0.0.1:0"}
    worker = {**common, "nthreads": 1, "memory_limit": 0, "silence_logs": logging.CRITICAL}
    nannies = {number: {"cls": Nanny, "options": worker} for number in range(count)}
    scheduler = {"cls": Scheduler, "options": {**common, "port": 0}}
    with silence_logging_cmgr(logging.CRITICAL), SpecCluster(scheduler=scheduler, workers=nannies) as workers:
        yield workers


def address_of(workers: Any) -> str:
    """Return the address of the workers' scheduler, which Dask's types take for an awaitable."""
    return workers.scheduler_address


def batch(*words: str) -> int:
    return status_of("batch", "ball.obj", *words)


def write_ball(folder: Path) -> Path:
    write_obj(folder / "ball.obj", quad_sphere(2))
    return folder / "ball.obj"

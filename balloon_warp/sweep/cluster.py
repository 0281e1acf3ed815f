"""Workers that simulate the shares of a batch: those of a running Dask scheduler, or processes of this machine."""

import logging
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from balloon_warp.errors import InputError, MissingExtraError

if TYPE_CHECKING:
    from distributed import Client, SpecCluster

CONNECT_SECONDS = 10.0
"""within which a scheduler answers"""
WORKER_SECONDS = 30.0
"""within which it has a worker"""
LOOPBACK = "127.0.0.1"
SETTINGS = {
    # A large mesh travels with its share: a copy that lay on one worker would be lost with it.
    "distributed.admin.large-graph-warning-threshold": "1 TiB",
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}


@dataclass(frozen=True)
class Cluster:
    """Which workers simulate a batch: one of `address`, `gpus` and `workers` is given.

    Raises:
        InputError: none or several are, or a number is below 1.
    """

    address: str | None = None
    """of a running scheduler, such as "tcp://192.168.0.1:8786" """
    gpus: int | None = None
    """how many GPUs of this machine, a worker each"""
    workers: int | None = None
    """how many processes on this machine's CPU"""
    prepare: Callable[[], None] | None = None
    """called in a worker before it does anything, to set up Warp's messages, say"""

    def __post_init__(self) -> None:
        if sum(choice is not None for choice in (self.address, self.gpus, self.workers)) != 1:
            raise InputError("--cluster, --gpus, --workers: expected one of them")
        for option, count in (("--gpus", self.gpus), ("--workers", self.workers)):
            if count is not None and count < 1:
                raise InputError(f"{option} {count}: expected at least 1")

    @property
    def option(self) -> str:
        """As a user gives it."""
        if self.address is not None:
            return f"--cluster {self.address}"
        return f"--gpus {self.gpus}" if self.gpus else f"--workers {self.workers}"

    def device(self, asked: str | None) -> str | None:
        """The device that each worker takes.

        Raises:
            InputError: a device is asked for besides this machine's GPUs or CPU.
        """
        if self.address is not None:
            return asked
        if asked:
            raise InputError(
                f"--device {asked}: goes with --cluster, not with --gpus or --workers, which say it already"
            )
        return "cuda:0" if self.gpus else "cpu"


@contextmanager
def connect(cluster: Cluster) -> Iterator["Client"]:
    """A client of the workers, once there is one. Workers that are started here end with the `with` block.

    Raises:
        MissingExtraError: dask.distributed is not installed.
        InputError: no scheduler answers at the address, it has no worker, or this machine has fewer GPUs.
    """
    try:
        import dask.config
        from distributed import Client
        from distributed.utils import silence_logging_cmgr
    except ImportError:
        raise MissingExtraError(
            f"{cluster.option} needs dask.distributed: pip install 'balloon-warp[cluster]'"
        ) from None
    with dask.config.set(SETTINGS), silence_logging_cmgr(logging.CRITICAL), ExitStack() as stack:
        place = cluster.address or stack.enter_context(_start_workers(_environments(cluster)))
        try:
            client = stack.enter_context(Client(place, timeout=CONNECT_SECONDS, set_as_default=False))
        except (OSError, ValueError, TypeError):
            raise InputError(
                f"{cluster.option}: no scheduler answers there; expected the address of a running one, such as "
                "tcp://192.168.0.1:8786"
            ) from None
        try:
            client.wait_for_workers(cluster.gpus or cluster.workers or 1, timeout=WORKER_SECONDS)
        except TimeoutError:
            raise InputError(
                f"{cluster.option}: the scheduler has no worker after {WORKER_SECONDS:.0f} s; start some with "
                f"`dask worker {cluster.address} --nthreads 1`, one for each GPU"
            ) from None
        yield client


def _environments(cluster: Cluster) -> list[dict[str, str]]:
    """Of each worker to start: which GPU it sees."""
    if not cluster.gpus:
        return [{}] * (cluster.workers or 0)
    import warp as wp

    if cluster.gpus > (present := wp.get_cuda_device_count()):
        raise InputError(f"{cluster.option}: this machine has {present}")
    visible = os.environ.get("CUDA_VISIBLE_DEVICES")
    names = visible.split(",") if visible else [str(number) for number in range(present)]
    return [{"CUDA_VISIBLE_DEVICES": name} for name in names[: cluster.gpus]]


def _start_workers(environments: list[dict[str, str]]) -> "SpecCluster":
    """A scheduler and workers that listen on loopback only. A worker that dies is replaced by its nanny."""
    from distributed import Nanny, Scheduler, SpecCluster

    common: dict[str, Any] = {"host": LOOPBACK, "dashboard": False}
    # Memory is estimated before a share is laid out: a second limit would only end good runs.
    worker = {**common, "nthreads": 1, "memory_limit": 0, "silence_logs": logging.CRITICAL}
    return SpecCluster(
        scheduler={"cls": Scheduler, "options": {**common, "port": 0, "dashboard_address": f"{LOOPBACK}:0"}},
        workers={
            number: {"cls": Nanny, "options": {**worker, "env": environment}}
            for number, environment in enumerate(environments)
        },
    )

"""Workers that simulate the shares of a batch: those of a running Dask scheduler, or processes of this machine."""

import atexit
import gc
import logging
import os
import re
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from balloon_warp.errors import InputError, MissingExtraError

if TYPE_CHECKING:
    from distributed import Client, SpecCluster

CONNECT_SECONDS = 10.0
"""Time within which a scheduler must answer [s]"""
WORKER_SECONDS = 30.0
"""Time within which a scheduler must have a worker [s]"""
EXAMPLE = "tcp://192.168.0.1:8786"
LOOPBACK = "127.0.0.1"
SETTINGS = {
    # A large mesh travels with its share: a copy that lay on one worker would be lost with it.
    "distributed.admin.large-graph-warning-threshold": "1 TiB",
    # Nobody looks at what it monitors, and no worker starts where it fails, as it does in some containers.
    "distributed.diagnostics.nvml": False,
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}


@dataclass(frozen=True)
class Cluster:
    """Workers that simulate a batch: one of `address`, `gpus` and `workers` is given.

    Raises:
        InputError: none or several are, the address is none, or a number is below 1.
    """

    address: str | None = None
    """Address of a running scheduler, such as `EXAMPLE`"""
    gpus: int | None = None
    """Number of GPUs of this machine, a worker each"""
    workers: int | None = None
    """Number of processes on this machine's CPU"""
    prepare: Callable[[], None] | None = None
    """Function called in each worker before anything else, for instance to set up Warp's messages"""

    def __post_init__(self) -> None:
        if sum(choice is not None for choice in (self.address, self.gpus, self.workers)) != 1:
            raise InputError("--cluster, --gpus, --workers: expected only one of them")
        if self.address is not None and not re.fullmatch(r"(tcp|tls)://[^/]+:\d+", self.address):
            raise InputError(f"--cluster {self.address}: expected an address such as {EXAMPLE}")
        for option, count in (("--gpus", self.gpus), ("--workers", self.workers)):
            if count is not None and count < 1:
                raise InputError(f"{option} {count}: expected at least 1")

    @property
    def option(self) -> str:
        """The option of the command line that asks for these workers."""
        if self.address is not None:
            return f"--cluster {self.address}"
        return f"--gpus {self.gpus}" if self.gpus else f"--workers {self.workers}"

    def device(self, asked: str | None) -> str | None:
        """Return the device of each worker.

        Raises:
            InputError: a device is asked for besides this machine's GPUs or CPU.
        """
        if self.address is not None:
            return asked
        if asked:
            raise InputError(f"--device {asked}: needs --cluster; --gpus and --workers choose the device themselves")
        return "cuda:0" if self.gpus else "cpu"


@contextmanager
def connect(cluster: Cluster) -> Iterator["Client"]:
    """Connect a client to the workers, once there is one. Workers that are started here end with the `with` block.

    Raises:
        MissingExtraError: dask.distributed is not installed.
        InputError: no scheduler answers at the address, it has no worker, this machine has fewer GPUs, or the workers
            that it is to start do not start.
    """
    try:
        import dask.config
        from distributed import Client
        from distributed.utils import LoopRunner, silence_logging_cmgr
    except ImportError:
        raise MissingExtraError(
            f"{cluster.option} needs dask.distributed: pip install 'balloon-warp[cluster]'"
        ) from None
    with dask.config.set(SETTINGS), silence_logging_cmgr(logging.CRITICAL), ExitStack() as stack:
        if cluster.address is None:
            try:
                workers = stack.enter_context(start_workers(worker_environments(cluster)))
            except RuntimeError:
                raise InputError(
                    f"{cluster.option}: the workers do not start; a script that starts them needs its main part under "
                    '`if __name__ == "__main__":`, since each worker imports it'
                ) from None
            yield stack.enter_context(Client(workers, set_as_default=False))
            return
        try:
            LoopRunner().run_sync(_identify, cluster.address)
            client = stack.enter_context(Client(cluster.address, timeout=CONNECT_SECONDS, set_as_default=False))
        except OSError:
            raise InputError(
                f"{cluster.option}: no scheduler answered within {CONNECT_SECONDS:g} s; expected a running one"
            ) from None
        try:
            client.wait_for_workers(1, timeout=WORKER_SECONDS)
        except TimeoutError:
            raise InputError(
                f"{cluster.option}: the scheduler has no worker after {WORKER_SECONDS:g} s; start one for each GPU "
                f"with `dask worker {cluster.address} --nthreads 1`"
            ) from None
        yield client


async def _identify(address: str) -> None:
    """Ask who is there: a client by itself would wait forever for the word of some other service."""
    import asyncio  # Dask has loaded it; a batch in one process does without

    from distributed import rpc

    async with rpc(address) as scheduler:
        await asyncio.wait_for(scheduler.identity(), CONNECT_SECONDS)


def worker_environments(cluster: Cluster) -> list[dict[str, str]]:
    """Return the environment of each worker to start: the GPU that it sees.

    Raises:
        InputError: this machine has fewer GPUs, or the same one is named twice.
    """
    if not cluster.gpus:
        return [{}] * (cluster.workers or 0)
    import warp as wp

    visible = os.environ.get("CUDA_VISIBLE_DEVICES")
    chosen = visible.split(",") if visible else []
    if len(set(chosen)) < len(chosen):
        raise InputError(f"CUDA_VISIBLE_DEVICES={visible}: names a GPU twice")
    if cluster.gpus > (present := wp.get_cuda_device_count()):
        raise InputError(f"{cluster.option}: this machine has {present}")
    names = chosen or [str(number) for number in range(present)]
    return [{"CUDA_VISIBLE_DEVICES": name} for name in names[: cluster.gpus]]


def start_workers(environments: list[dict[str, str]]) -> "SpecCluster":
    """Start a scheduler and workers that listen on loopback only. A worker that dies is replaced by its nanny."""
    from distributed import Nanny, Scheduler, SpecCluster

    common: dict[str, Any] = {"host": LOOPBACK, "dashboard": False, "dashboard_address": f"{LOOPBACK}:0"}
    # Memory is estimated before a share is laid out: a second limit would only end good runs.
    worker = {**common, "nthreads": 1, "memory_limit": 0, "silence_logs": logging.CRITICAL, "preload": [__name__]}
    return SpecCluster(
        scheduler={"cls": Scheduler, "options": {**common, "port": 0}},
        workers={
            number: {"cls": Nanny, "options": {**worker, "env": environment}}
            for number, environment in enumerate(environments)
        },
    )


def dask_setup(_: Any) -> None:
    """Set up each worker that is started here, as Dask calls it.

    A terminal sends Ctrl-C to all, and it is for the first process, which saves what there is and ends them. Workers
    end at once, without a last garbage collection.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    atexit.register(gc.freeze)

"""Workers: their number on this machine or the address of a scheduler, and their protocol."""

import os
import re
import time
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from balloon_warp.errors import InputError, NoRoomError
from balloon_warp.system.arguments import check_fields
from balloon_warp.system.warp_setup import quiet_warp

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

"""Workers as a batch sees them: shares of work go to them, and news of these come back in any order."""

import os
import time
from collections.abc import Callable, Container, Sequence
from typing import Any, NamedTuple, Protocol

from balloon_warp.errors import NoRoomError

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

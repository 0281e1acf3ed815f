"""What the tests of stopped batches share."""

import os
import signal
from collections.abc import Callable
from pathlib import Path

from balloon_warp.sweep.output import STAGE_NAME

OFTEN = 1e-9
"""seconds between checkpoints: one after every frame"""
NAMES = ("table.npz", "table.csv", STAGE_NAME)


def contents(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in NAMES if (folder / name).exists()}


def press_ctrl_c_once(begun: Callable[[int], bool]) -> Callable[[int], None]:
    """At the first frame of which that is true."""
    pressed: list[int] = []

    def press(frame: int) -> None:
        if not pressed and begun(frame):
            pressed.append(frame)
            os.kill(os.getpid(), signal.SIGINT)

    return press

"""Helpers of the tests of stopped runs and batches, a small batch that can be stopped, and workers of clusters."""

import csv
import logging
import os
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from commands import status_of
from meshes import quad_sphere

from balloon_warp import Scene
from balloon_warp.batch.task import STAGE_NAME
from balloon_warp.mesh.obj import write_obj
from balloon_warp.scene import Balloon, Ground, Inflation, Sphere, String

FRAMES, WORLDS = 6, 5
OFTEN = 1e-9
"""seconds between checkpoints: one after every frame"""
NAMES = ("table.npz", "table.csv", "worlds.npz", "worlds.csv", STAGE_NAME)


def contents(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in NAMES if (folder / name).exists()}


def assert_text_has_the_numbers_of(table: Path) -> None:
    """Require that a table's .csv has all columns of its .npz, to the last bit."""
    with table.with_suffix(".csv").open(encoding="utf-8", newline="") as file, np.load(table) as columns:
        header, *rows = csv.reader(file)
        assert header == list(columns)
        for name, texts in zip(header, zip(*rows, strict=True), strict=True):
            np.testing.assert_array_equal(np.array(texts).astype(columns[name].dtype), columns[name], err_msg=name)


@contextmanager
def files_limited_to(size: int) -> Iterator[None]:
    """Let no file become larger than a number of bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def press_ctrl_c_once(begun: Callable[[int], bool]) -> Callable[[int], None]:
    """Return a callback that sends SIGINT once, at the first frame for which `begun` is true."""
    pressed: list[int] = []

    def press(frame: int) -> None:
        if not pressed and begun(frame):
            pressed.append(frame)
            os.kill(os.getpid(), signal.SIGINT)

    return press


def scene(**fields) -> Scene:
    """Return a small scene with one of each kind of thing."""
    fields = {
        "balloon": [Balloon(mesh=quad_sphere(3), position=(0, 2, 0), helium=20.0, inflation=Inflation(k_normal=0.2))],
        "sphere": [Sphere(position=(0, 4, 0), radius=0.3, start=0.03)],
        "string": [String(anchor=(0, 0, 0), length=1.5)],
        "ground": Ground(),
        "frames": FRAMES,
        "substeps": 40,
        "faces": False,
    } | fields
    return Scene(**fields)


def stop_after(last: int) -> Callable[[int], None]:
    """Return a callback that kills a batch once that frame is simulated, before any of it is saved."""

    def stop(frame: int) -> None:
        if frame == last:
            raise RuntimeError("stopped")

    return stop


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

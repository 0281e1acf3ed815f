"""Time of a batch from start to end beside its simulation alone, and speed of trajectories beside a plain file's.

    python -m balloon_warp.benchmarks.batches tables [DEVICE] [WORLDS] [FRAMES]
    python -m balloon_warp.benchmarks.batches trajectories [DEVICE] [WORLDS] [FRAMES]

needs the extra `data`.
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
import warp as wp

from balloon_warp.batch.batch import run_batch
from balloon_warp.batch.recorder import bytes_of_frame
from balloon_warp.batch.trajectories import TrajectoryFiles
from balloon_warp.model import plan_model
from balloon_warp.scene import load_scene
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.system.warp_threads import pick_device

VARIED = "balloon.helium"
FORMATS: tuple[Literal["h5", "zarr", "npz"], ...] = ("h5", "zarr", "npz")
CHUNK = 1 << 24
"""Bytes of a plain file that are written at a time"""


def squirrels(frames: int) -> Any:
    """Return a squirrel on a string."""
    return load_scene("squirrel_tether").model_copy(update={"frames": frames})


def seconds_of(work: Callable[[], Any]) -> float:
    """Return the seconds that something takes [s]."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def simulation_seconds(device: Any, worlds: int, frames: int) -> float:
    """Return the seconds of the bare frames, after one that compiles [s]."""
    simulator = Simulator(squirrels(frames), str(device), worlds)

    def frames_of(count: int) -> None:
        for _ in range(count):
            simulator.advance()
        wp.synchronize_device(device)

    frames_of(2)
    return seconds_of(lambda: frames_of(frames))


def batch_seconds(device: Any, worlds: int, frames: int, trajectories: TrajectoryFiles | None = None) -> float:
    """Return the seconds of a batch from start to end, tables written [s]."""
    vary = {VARIED: np.linspace(8.0, 16.0, worlds)}
    with tempfile.TemporaryDirectory() as folder:
        options: dict[str, Any] = {"trajectories": trajectories, "device": str(device)}
        return seconds_of(lambda: run_batch(squirrels(frames), folder, worlds, vary, **options))


def plain_seconds(folder: Path, size: int) -> float:
    """Return the seconds in which a plain file of so many bytes is written, and is on the disk [s]."""
    block = np.random.default_rng(0).bytes(CHUNK)

    def write() -> None:
        with open(folder / "plain", "wb") as file:
            for begin in range(0, size, CHUNK):
                file.write(block[: size - begin])
            file.flush()
            os.fsync(file.fileno())

    seconds = seconds_of(write)
    (folder / "plain").unlink()
    return seconds


def print_tables(device: Any, worlds: int, frames: int) -> None:
    """Print how long a batch takes beside its simulation."""
    alone = simulation_seconds(device, worlds, frames)
    batch_seconds(device, 64, 1)  # compiles
    whole = batch_seconds(device, worlds, frames)
    print(f"squirrel_tether, {worlds:,} worlds, {frames} frames: simulation {alone:.1f} s, a batch {whole:.1f} s")
    print(f"  {(whole - 3.0) / alone:.2f} of the simulation, but for 3 s")


def print_trajectories(device: Any, worlds: int, frames: int) -> None:
    """Print how fast trajectories are written beside the simulation, and a plain file by itself."""
    batch_seconds(device, 64, 1)  # compiles
    without = batch_seconds(device, worlds, frames)
    raw = worlds * (frames + 1) * bytes_of_frame(plan_model(squirrels(frames), 1))
    print(f"squirrel_tether, {worlds:,} worlds, {frames} frames: a batch with tables alone {without:.1f} s")
    print(f"  {raw / 1e9:.3g} GB of numbers")
    for form in FORMATS:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            seconds = batch_seconds(device, worlds, frames, TrajectoryFiles(folder / "data", format=form))
            size = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
            plain = plain_seconds(folder, size)
        rates = (
            f"{raw / seconds / 1e6:,.0f} MB/s of numbers from start to end; a plain file {size / plain / 1e6:,.0f} MB/s"
        )
        print(f"  {form}: {size / 1e9:.3g} GB, {size / raw:.0%} of them, in {seconds:.1f} s, {rates}", flush=True)


def main() -> None:
    quiet_warp()
    what, *rest = sys.argv[1:] or ["tables"]
    device = pick_device(rest[0] if rest else None)
    ways = {"tables": (print_tables, 16384, 120), "trajectories": (print_trajectories, 1024, 60)}
    if what not in ways:
        raise SystemExit(f"{what}: expected {' or '.join(ways)}")
    way, worlds, frames = ways[what]
    sizes = [int(word) for word in rest[1:3]] or [worlds, frames]
    print(device)
    way(device, *sizes)


if __name__ == "__main__":
    main()

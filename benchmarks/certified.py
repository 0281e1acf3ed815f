"""Does anything cross anything? Bundled scenes simulated for long, every frame checked as `balloon-warp check` does.

    python -m balloon_warp.benchmarks.certified [SCENE ...] [--frames 10000] [--seconds 300] [--device cpu]

simulates each scene for as many frames, or for as long, and prints a table: frames, in how many of
them anything crosses or is in anything, how deep that is at most, and where. It ends with status 1 if there is any.
Frames are checked by other processes, on the CPU, while more are simulated.
"""

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import chain, islice
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

from balloon_warp.benchmarks.cases import ContactCase
from balloon_warp.frame import Frame
from balloon_warp.scene import Scene, Touch, load_scene
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.tools.check import CheckReport, check_stage
from balloon_warp.usd import StageWriter

SCENES = ("balloon_pit", "press", "table", "knot", "packed", "airbag")
EIGHT = ContactCase("eight", "gather", 1, "touch", near=True)
"""Eight balloons in a box that is too small for them"""
FRAMES_OF_STAGE = 250
"""Number of frames that are checked together"""


def packed() -> Scene:
    """Return the scene of eight balloons, whose edges touch each other."""
    scene = EIGHT.scene()
    touch = (scene.touch or Touch()).model_copy(update={"edges": True})
    return scene.model_copy(update={"touch": touch})


@dataclass(frozen=True)
class Certificate:
    """Result for one scene."""

    scene: str
    frames: int
    crossed: int
    """Number of frames in which anything crosses"""
    depth: float
    """Largest depth of one thing in another [m]"""
    where: str
    seconds: float


def certify(
    name: str,
    frames: int,
    device: str | None = None,
    folder: Path | None = None,
    seconds: float = float("inf"),
    processes: int = 1,
) -> Certificate:
    """Simulate a scene for a number of frames, and check each.

    Args:
        folder: where its stages are kept, of some frames each; a temporary one if not given.
        seconds: Time after which no more are simulated [s].
        processes: Number of processes that check.
    """
    start = time.perf_counter()
    scene = packed() if name == "packed" else load_scene(name)
    simulator = Simulator(scene.model_copy(update={"frames": frames}), device)
    begin = simulator.read_frame()
    run = _until(simulator.run(ahead=True), start + seconds)
    with TemporaryDirectory() as temporary, ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        reports = []
        for first in run:
            stage = (folder or Path(temporary)) / f"{name}_{first.number:05d}.usdc"
            with StageWriter(stage, simulator.model) as writer:
                if first.number:
                    writer.write(begin)  # by which quads are cut into triangles
                for frame in chain([first], islice(run, FRAMES_OF_STAGE - 1)):
                    writer.write(frame)
            reports.append(pool.submit(_check, stage, first.number))
        return _certificate(name, [report.result() for report in reports], time.perf_counter() - start)


def _until(frames: Iterator[Frame], end: float) -> Iterator[Frame]:
    """Yield frames until a time of the clock [s]."""
    for frame in frames:
        yield frame
        if time.perf_counter() > end:
            return


def _check(stage: Path, first: int) -> CheckReport:
    """Check the frames of a stage from one on, in another process."""
    quiet_warp()
    return check_stage(stage, frames=(first, None), device="cpu")


def _certificate(name: str, reports: Sequence[CheckReport], seconds: float) -> Certificate:
    """Sum up the reports of the stages of a scene."""
    found = [crossing for report in reports for crossing in report.crossings]
    worst = max(found, key=lambda crossing: crossing.depth, default=None)
    checked, crossed = sum(report.frames for report in reports), len({crossing.frame for crossing in found})
    return Certificate(name, checked, crossed, worst.depth if worst else 0.0, str(worst or "-"), seconds)


def main(words: Sequence[str] | None = None) -> int:
    """Certify the scenes of a command line.

    Args:
        words: of it; if missing, those that Python was started with.
    """
    parser = argparse.ArgumentParser(prog="python -m balloon_warp.benchmarks.certified", description=__doc__)
    parser.add_argument("scene", nargs="*", default=SCENES)
    parser.add_argument("--frames", type=int, default=10_000, help="of each scene")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="after which each scene ends sooner")
    parser.add_argument("--processes", type=int, default=1, help="that check frames")
    parser.add_argument("--device")
    parser.add_argument("--folder", type=Path, help="where stages are kept")
    asked = parser.parse_args(words)
    if asked.frames < 1:
        parser.error(f"--frames: {asked.frames}; expected 1 or more")
    quiet_warp()
    print(f"{'scene':<14}{'frames':>8}{'crossed':>9}{'deepest [m]':>13}{'seconds':>9}  where", flush=True)
    failed = 0
    for name in asked.scene:
        one = certify(name, asked.frames, asked.device, asked.folder, asked.seconds, asked.processes)
        failed += one.crossed
        line = f"{one.scene:<14}{one.frames:>8}{one.crossed:>9}{one.depth:>13.2g}{one.seconds:>9.0f}  {one.where}"
        print(line, flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())

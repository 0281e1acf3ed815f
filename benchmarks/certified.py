"""Does anything cross anything? Bundled scenes simulated for long, every frame checked as `balloon-warp check` does.

    python -m balloon_warp.benchmarks.certified [SCENE ...] [--frames 10000] [--device cpu]

simulates each scene for as many frames and prints a table: frames, in how many of
them anything crosses or is in anything, how deep that is at most, and where. It ends with status 1 if there is any.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from balloon_warp.benchmarks.cases import ContactCase
from balloon_warp.checking import check_stage
from balloon_warp.job import animate
from balloon_warp.scene import Scene, Touch, load_scene
from balloon_warp.warp_logging import quiet_warp

SCENES = ("balloon_pit", "press", "knot", "packed", "airbag")
EIGHT = ContactCase("eight", "gather", 1, "touch", near=True)
"""Eight balloons in a box that is too small for them"""


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


def certify(name: str, frames: int, device: str | None = None, folder: Path | None = None) -> Certificate:
    """Simulate a scene for a number of frames, and check each.

    Args:
        folder: where its stage is kept; a temporary one if not given.
    """
    start = time.perf_counter()
    with TemporaryDirectory() as temporary:
        stage = (folder or Path(temporary)) / f"{name}.usdc"
        scene = packed() if name == "packed" else load_scene(name)
        animate(scene.model_copy(update={"frames": frames}), stage, device=device)
        report = check_stage(stage, device=device)
    worst = max(report.crossings, key=lambda crossing: crossing.depth, default=None)
    crossed = len({crossing.frame for crossing in report.crossings})
    return Certificate(
        name, frames, crossed, worst.depth if worst else 0.0, str(worst or "-"), time.perf_counter() - start
    )


def main(words: Sequence[str] | None = None) -> int:
    """Certify what a command line asks for.

    Args:
        words: of it; if missing, those that Python was started with.
    """
    parser = argparse.ArgumentParser(prog="python -m balloon_warp.benchmarks.certified", description=__doc__)
    parser.add_argument("scene", nargs="*", default=SCENES)
    parser.add_argument("--frames", type=int, default=10_000, help="of each scene")
    parser.add_argument("--device")
    parser.add_argument("--folder", type=Path, help="where stages are kept")
    asked = parser.parse_args(words)
    if asked.frames < 1:
        parser.error(f"--frames: {asked.frames}; expected 1 or more")
    quiet_warp()
    print(f"{'scene':<14}{'frames':>8}{'crossed':>9}{'deepest [m]':>13}{'seconds':>9}  where", flush=True)
    failed = 0
    for name in asked.scene:
        one = certify(name, asked.frames, asked.device, asked.folder)
        failed += one.crossed
        line = f"{one.scene:<14}{one.frames:>8}{one.crossed:>9}{one.depth:>13.2g}{one.seconds:>9.0f}  {one.where}"
        print(line, flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())

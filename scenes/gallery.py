"""Pictures of docs/, made again.

`python -m balloon_warp.scenes.gallery docs/pictures` makes them all, with names of scenes behind it those.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from balloon_warp import animate, bundled_scenes, compare, load_scene, render_stage, run_batch

SIZE, MOVING_SIZE = (640, 360), (480, 270)
SAMPLES = 16


class Moving(NamedTuple):
    """Part of a scene's run that an animation shows."""

    first: int
    last: int
    frames_per_second: float


MOVING = {
    "foil_letters": Moving(0, 80, 20.0),
    "bowl_to_sphere": Moving(0, 90, 20.0),
    "bunch_in_wind": Moving(72, 150, 15.0),
    "helium_rise": Moving(0, 36, 30.0),
    "knot": Moving(30, 300, 10.0),
    "latex_inflate": Moving(0, 120, 15.0),
    "letter_slot": Moving(70, 230, 15.0),
    "rocket_balloon": Moving(0, 66, 20.0),
    "squirrel_inflate": Moving(0, 150, 15.0),
    "table": Moving(60, 240, 15.0),
}
"""Scenes of which there is an animation, too"""


def main(folder: Path, names: Sequence[str] = ()) -> None:
    """Simulate bundled scenes, and write a picture of each and animations of some.

    Args:
        folder: where they go.
        names: of the scenes; all if there are none, with a comparison and a batch besides.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as stages:
        for name in names or bundled_scenes():
            stage = Path(stages) / f"{name}.usdc"
            animate(load_scene(name), stage)
            render_stage(stage, folder / f"{name}.png", size=SIZE, samples=SAMPLES)
            if shown := MOVING.get(name):
                moving, part = folder / f"{name}.webp", (shown.first, shown.last)
                render_stage(stage, moving, size=MOVING_SIZE, frames=part, frames_per_second=shown.frames_per_second)
            print(f"wrote {folder / name}.png", flush=True)
        if names:
            return
        compare(load_scene("turtle_provot"), {"correction": ["none", "provot"]}, folder / "correction.png")
        inflation = np.linspace(0.5, 8.0, 9)
        batch = load_scene("squirrel_inflate", [("frames", 90)])
        run_batch(batch, stages, len(inflation), {"balloon.inflation.k_normal": inflation}, export=range(9))
        render_stage(Path(stages) / "worlds.usdc", folder / "batch.png", size=SIZE, samples=SAMPLES)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/pictures"), sys.argv[2:])

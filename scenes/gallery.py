"""Pictures of docs/, made again."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from balloon_warp import animate, bundled_scenes, compare, load_scene, render_stage, run_batch
from balloon_warp.errors import did_you_mean

SIZE, MOVING_SIZE = (640, 360), (480, 270)
SAMPLES = 16


class Moving(NamedTuple):
    """Part of a scene's run that an animation shows."""

    first: int
    last: int
    frames_per_second: float
    zoom: float | None = None
    look_at: tuple[float, float, float] | None = None


MOVING = {
    "airbag": Moving(0, 150, 15.0),
    "foil_letters": Moving(0, 80, 20.0),
    "bowl_to_sphere": Moving(0, 90, 20.0),
    "bunch_in_wind": Moving(24, 150, 15.0, zoom=1.1),
    "helium_rise": Moving(0, 48, 30.0, zoom=1.8, look_at=(0.0, 0.72, 0.0)),
    "knot": Moving(30, 200, 10.0, zoom=1.25),
    "latex_inflate": Moving(0, 120, 15.0),
    "letter_slot": Moving(70, 230, 15.0),
    "rocket_balloon": Moving(40, 124, 20.0, zoom=1.15),
    "squirrel_inflate": Moving(0, 150, 15.0),
    "table": Moving(60, 240, 15.0),
    "turtle_pillow": Moving(100, 280, 15.0),
}
"""Scenes of which there is an animation, too"""


def main(words: Sequence[str] | None = None) -> None:
    """Make the pictures that a command line asks for.

    Args:
        words: of it; if missing, those that Python was started with.
    """
    parser = argparse.ArgumentParser(prog="python -m balloon_warp.scenes.gallery", description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default="docs/pictures", help="default: docs/pictures")
    parser.add_argument(
        "scenes", nargs="*", help="bundled scenes; all of them, a comparison and a batch if none is named"
    )
    asked = parser.parse_args(words)
    for name in asked.scenes:
        if name not in bundled_scenes():
            parser.error(f"{name}: no such bundled scene{did_you_mean(name, bundled_scenes())}")
    try:
        asked.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        parser.error(f"{asked.folder}: cannot be a folder: {error.strerror}")
    make_pictures(asked.folder, asked.scenes)


def make_pictures(folder: Path, names: Sequence[str] = ()) -> None:
    """Simulate bundled scenes, and write a picture of each and animations of some.

    Args:
        folder: where they go.
        names: of the scenes; all if there are none, with a comparison and a batch besides.
    """
    with TemporaryDirectory() as stages:
        for name in names or bundled_scenes():
            stage = Path(stages) / f"{name}.usdc"
            animate(load_scene(name), stage)
            render_stage(stage, folder / f"{name}.png", size=SIZE, samples=SAMPLES)
            if shown := MOVING.get(name):
                first, last, rate, zoom, look_at = shown
                moving, view = folder / f"{name}.webp", {"zoom": zoom, "look_at": look_at}
                render_stage(stage, moving, size=MOVING_SIZE, frames=(first, last), frames_per_second=rate, **view)
            print(f"wrote {folder / name}.png", flush=True)
        if names:
            return
        compare(load_scene("turtle_provot"), {"correction": ["none", "provot"]}, folder / "correction.png")
        inflation = np.linspace(0.5, 8.0, 9)
        batch = load_scene("squirrel_inflate", [("frames", 90)])
        run_batch(batch, stages, len(inflation), {"balloon.inflation.k_normal": inflation}, export=range(9))
        render_stage(Path(stages) / "worlds.usdc", folder / "batch.png", size=SIZE, samples=SAMPLES)


if __name__ == "__main__":
    main()

"""Scene of a hundred balloons in a pit.

Run it by python -m balloon_warp.scenes.pit; a smaller one with --columns 2 --layers 2, say, and the file to write.
"""

import argparse
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.scenes.model_bead import RADIUS
from balloon_warp.system.files import check_writable

COLUMNS, LAYERS = 5, 4
"""balloons along each side of the box, and one over the other"""
SPACING = 2.52 * RADIUS
WALL = 0.4
"""its height [m]"""
THICK = 0.12
"""of floor and walls [m]: more than a face is wide, or their edges would stick into balloons"""
COLORS = ("0.70, 0.05, 0.05", "0.85, 0.55, 0.02", "0.05, 0.40, 0.10", "0.03, 0.15, 0.60", "0.80, 0.80, 0.80")

HEAD = """description = "A ball rolls through {} balloons in a box"
frames = 210
picture_frame = 138
contact = "impulse"
"""
BALLOON = """
[[balloon]]
mesh = "bead.obj"
position = [{}, {}, {}]
mass = 0.02
damping = 0.02
color = [{}]
stiffness = {{ structural = 20.0, shear = 10.0, flexion = 2.0 }}
"""
OBSTACLE = """
[[obstacle]]
name = "{}"
size = [{}, {}, {}]
position = [{}, {}, {}]
friction = 0.2
color = [0.35, 0.38, 0.42]
"""
REST = """
[[sphere]]
radius = 0.2
mass = 0.5
color = [0.02, 0.02, 0.02]
position = [{}, 0.85, 0.1]
velocity = [2.0, 0.0, 0.0]
start = 2.0

[touch]
edges = true # else balloons cross by 1 cm; with `faces = false`, too, walls by 3 cm, and it is 2.6 times as fast
thickness = 0.006
stiffness = 200.0

[ground]
height = -0.12

[box]
lower = [{}, 0.0, {}]
upper = [{}, 1.0, {}]
"""


def half_width(columns: int = COLUMNS) -> float:
    """Return half the box's width [m]."""
    return round(0.5 * (columns + 1) * SPACING + 0.004, 2)


HALF = half_width()


def scene(columns: int = COLUMNS, layers: int = LAYERS) -> str:
    """Return the scene file: layers of balloons, each a little turned against the one below, over a box."""
    random, half = np.random.default_rng(1), half_width(columns)
    places = (np.arange(columns) - 0.5 * (columns - 1)) * SPACING
    count = columns * columns * layers
    text = HEAD.format("a hundred" if count == 100 else count)
    for layer in range(layers):
        for x in places:
            for z in places:
                shift = random.uniform(-0.01, 0.01, 2)
                at = [f"{x + shift[0]:.3f}", f"{0.13 + layer * SPACING:.3f}", f"{z + shift[1]:.3f}"]
                text += BALLOON.format(*at, COLORS[random.integers(len(COLORS))])
    width = round(2 * (half + THICK), 2)
    text += OBSTACLE.format("floor", width, THICK, width, 0.0, -0.5 * THICK, 0.0)
    for axis, side in ((0, -1), (0, 1), (2, -1), (2, 1)):
        size, place = np.array([2 * half, WALL, 2 * half]), np.array([0.0, 0.5 * WALL, 0.0])
        size[axis], size[2 - axis], place[axis] = THICK, (2 * half, width)[axis == 0], side * (half + 0.5 * THICK)
        text += OBSTACLE.format("wall", *size.round(3), *place.round(3))
    return text + REST.format(round(0.26 - half, 2), -half, -half, half, half)


def main(words: Sequence[str] | None = None) -> None:
    """Write the scene that a command line names.

    Args:
        words: of it; if missing, those that Python was started with.
    """
    parser = argparse.ArgumentParser(prog="python -m balloon_warp.scenes.pit", description=__doc__)
    parser.add_argument("path", type=Path, nargs="?", default=Path(__file__).parent / "balloon_pit.toml")
    parser.add_argument("--columns", type=int, default=COLUMNS, help="balloons along each side of the box")
    parser.add_argument("--layers", type=int, default=LAYERS, help="how many lie one over the other")
    asked = parser.parse_args(words)
    if min(asked.columns, asked.layers) < 1:
        parser.error("--columns, --layers: expected at least 1")
    try:
        check_writable(asked.path, (".toml",))
    except InputError as mistake:
        parser.error(str(mistake))
    asked.path.write_text(scene(asked.columns, asked.layers), encoding="utf-8")
    bead = Path(__file__).parent / "bead.obj"
    if not (asked.path.parent / bead.name).exists():
        shutil.copy(bead, asked.path.parent)
        print(f"wrote {asked.path.parent / bead.name}")
    print(f"wrote {asked.path}: {asked.columns**2 * asked.layers} balloons")


if __name__ == "__main__":
    main()

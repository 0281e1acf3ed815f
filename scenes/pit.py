"""Writes the scene of a hundred balloons: python -m balloon_warp.scenes.pit"""

from pathlib import Path

import numpy as np

from balloon_warp.scenes.model_bead import RADIUS

COLUMNS, LAYERS = 5, 4
"""balloons along each side of the box, and one over the other"""
SPACING = 2.52 * RADIUS
HALF = 0.76
"""of the box's width [m]"""
WALL = 0.4
"""its height [m]"""
THICK = 0.12
"""of floor and walls [m]: more than a face is wide, or their edges would stick into balloons"""
COLORS = ("0.70, 0.05, 0.05", "0.85, 0.55, 0.02", "0.05, 0.40, 0.10", "0.03, 0.15, 0.60", "0.80, 0.80, 0.80")

HEAD = """description = "A ball rolls through a hundred balloons in a box"
frames = 300
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
position = [-0.5, 0.85, 0.1]
velocity = [2.0, 0.0, 0.0]
start = 2.0

[touch]
thickness = 0.006
stiffness = 200.0

[ground]
height = -0.12

[box]
lower = [{}, 0.0, {}]
upper = [{}, 1.0, {}]
"""


def scene() -> str:
    """The scene file: four layers of balloons, each a little turned against the one below, over a box."""
    random = np.random.default_rng(1)
    places = (np.arange(COLUMNS) - 0.5 * (COLUMNS - 1)) * SPACING
    text = HEAD
    for layer in range(LAYERS):
        for x in places:
            for z in places:
                shift = random.uniform(-0.01, 0.01, 2)
                at = [f"{x + shift[0]:.3f}", f"{0.13 + layer * SPACING:.3f}", f"{z + shift[1]:.3f}"]
                text += BALLOON.format(*at, COLORS[random.integers(len(COLORS))])
    width = 2 * (HALF + THICK)
    text += OBSTACLE.format("floor", width, THICK, width, 0.0, -0.5 * THICK, 0.0)
    for axis, side in ((0, -1), (0, 1), (2, -1), (2, 1)):
        size, place = np.array([2 * HALF, WALL, 2 * HALF]), np.array([0.0, 0.5 * WALL, 0.0])
        size[axis], size[2 - axis], place[axis] = THICK, (2 * HALF, width)[axis == 0], side * (HALF + 0.5 * THICK)
        text += OBSTACLE.format("wall", *size.round(3), *place.round(3))
    return text + REST.format(-HALF, -HALF, HALF, HALF)


if __name__ == "__main__":
    path = Path(__file__).parent / "balloon_pit.toml"
    path.write_text(scene(), encoding="utf-8")
    print(f"{path}: {COLUMNS * COLUMNS * LAYERS} balloons")

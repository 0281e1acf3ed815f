"""Table of the gradient of a bounce beside the slope that it is to be: of a ball's height by its speed before.

python -m balloon_warp.benchmarks.gradients bounce

The slope is that of a line through the heights of many worlds, whose speeds differ by a tenth in all; the gradient is
the mean over them. A soft ball crumples: there both are those of `smooth`.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

import balloon_warp as bw
from balloon_warp.mesh.topology import quad_sphere

SPEED, SPREAD, WORLDS = 2.0, 0.2, 65
"""Mean speed of the fall, range of the speeds [m/s], and their number"""
PATH = "balloon.velocity.1"
FLOORS = ("ground", "obstacle", "sphere, impulse", "sphere, penalty")
"""What it falls on: an obstacle is a box; a sphere is large and heavy, with one rule of contact or the other"""
DEVIATION, SAMPLES = 0.1, 256
"""Standard deviation of the speed of a soft ball [m/s], and the number of its samples"""


def tables() -> Iterator[str]:
    """Yield the lines of the table."""
    yield "a stiff ball on: slope of its height by its speed, mean gradient, off by; deviation of the gradients"
    for floor in FLOORS:
        for friction in (0.0, 0.5) if floor != "sphere, penalty" else (0.0,):
            slope, gradients = slope_and_gradients(floor, friction)
            mean = gradients.mean()
            off = f"{abs(mean / slope - 1.0):.1%}; {gradients.std():.2g}"
            yield f"  {floor}, friction {friction:g}: {slope:.4f} s, {mean:.4f} s, {off}"
    yield "a soft ball on the ground, smoothed: slope of its height by its speed, gradient, its standard error"
    for friction in (0.0, 0.5):
        found = bw.gradient(
            _soft(friction), of=[PATH], loss=_height, smooth={PATH: DEVIATION}, samples=SAMPLES, device="cpu"
        )
        slope, mean, error = (float(each[PATH][0]) for each in (found.slopes, found.gradients, found.errors))
        yield f"  friction {friction:g}: {slope:.3f} s, {mean:.3f} s, {error:.3f} s"


def slope_and_gradients(floor: str, friction: float, worlds: int = WORLDS) -> tuple[float, np.ndarray]:
    """Return the slope of the height by the speed over all worlds [s], and their gradients, shape (worlds,).

    Args:
        floor: One of `FLOORS`.
        friction: of the floor.
        worlds: their number.
    """
    speeds = np.linspace(-SPEED - 0.5 * SPREAD, -SPEED + 0.5 * SPREAD, worlds)
    found = bw.gradient(
        _scene(floor, friction), of=[PATH], loss=_height, world_count=worlds, vary={PATH: speeds}, device="cpu"
    )
    return float(np.polyfit(speeds, found.loss, 1)[0]), np.asarray(found.gradients[PATH], dtype=float)


def _soft(friction: float) -> bw.Scene:
    ball = bw.Balloon(
        mesh=quad_sphere(8, 0.5),
        damping=0.0,
        velocity=(0.0, -3.0, 0.0),
        inflation=bw.Inflation(kind="gas", start_pressure=200.0),
    )
    return bw.Scene(
        balloon=[ball], gravity=0.0, frames=40, substeps=48, ground=bw.Ground(height=-0.75, friction=friction)
    )


def _scene(floor: str, friction: float) -> bw.Scene:
    ball = bw.Balloon(
        mesh=quad_sphere(5, 0.5), mass=0.3, damping=0.0, velocity=(0.5, -SPEED, 0.0),
        stiffness=bw.Stiffness(structural=300.0, shear=150.0, flexion=30.0, viscosity=5e-4),
        inflation=bw.Inflation(kind="gas", start_pressure=500.0),
    )  # fmt: skip
    at = -0.75
    solids: dict[str, Any] = {"ground": bw.Ground(height=at, friction=friction)}
    if floor == "obstacle":
        solids = {"obstacle": [bw.Obstacle(size=(6.0, 1.0, 6.0), position=(0.0, at - 0.5, 0.0), friction=friction)]}
    if floor.startswith("sphere"):
        far = (0.0, at - 20.0, 0.0)
        solids = {"sphere": [bw.Sphere(position=far, radius=20.0, mass=1e9, friction=friction)], "faces": False}
        solids["contact"] = floor.partition(", ")[2]
    return bw.Scene(balloon=[ball], gravity=0.0, frames=30, substeps=64, **solids)


def _height(moved: bw.Trajectories) -> tuple[Any, dict[str, Any]]:
    heights = moved.points[0][:, -1, :, 1]
    slopes = np.zeros_like(moved.points[0])
    slopes[:, -1, :, 1] = 1.0 / heights.shape[1]
    return heights.mean(axis=1, dtype=float), {"points": [slopes]}

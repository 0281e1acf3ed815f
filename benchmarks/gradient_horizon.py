"""Table of gradients against differences over ever longer times: where chaos begins, a derivative tells ever less.

python -m balloon_warp.benchmarks.gradients horizon

A ball falls, onto the ground or between pins. The derivative is of its center's final x by its initial x. Differences
are of runs that start so much to either side.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

import balloon_warp as bw
from balloon_warp.mesh.topology import quad_sphere

FRAMES = (4, 8, 16, 32, 48, 64, 80, 96, 128)
REACHES = (1e-3, 1e-4)
"""To either side [m]"""
PINS = [(0.02, -0.5), (-0.35, -1.0), (0.37, -1.0), (0.0, -1.5), (-0.72, -1.5), (0.7, -1.5), (-0.35, -2.0), (0.35, -2.0)]
"""Places of pins across the plane in which the ball falls [m]"""
PATH = "balloon.position.0"


def tables() -> Iterator[str]:
    """Yield the lines of a table for each scene."""
    for name, obstacles in {"falls on the ground": [], "falls between pins": [_pin(*place) for place in PINS]}.items():
        yield f"{name}: substeps, d(x at the end) / d(x at the start), differences over {REACHES} m, off by"
        of = _scene(obstacles)
        differences = _differences(of)
        for frames in FRAMES:
            found = bw.gradient(of, {"frames": frames}, of=[PATH], loss=_center, device="cpu").gradients[PATH][0]
            told = [each[frames] for each in differences]
            off = ", ".join(f"{abs(found / each - 1.0):.1e}" for each in told)
            listed = ", ".join(f"{each:.5g}" for each in told)
            yield f"  {frames * of.substeps:5d}  {found:12.5g}  {listed}  {off}"


def _pin(x: float, y: float) -> bw.Obstacle:
    return bw.Obstacle(radius=0.08, length=2.0, rotation=(90.0, 0.0, 0.0), position=(x, y, 0.0), friction=0.0)


def _scene(obstacles: list[bw.Obstacle]) -> bw.Scene:
    ball = bw.Balloon(
        mesh=quad_sphere(3, 0.2), mass=0.1, damping=0.0, inflation=bw.Inflation(pressure=100.0),
        stiffness=bw.Stiffness(structural=200.0, shear=80.0, flexion=40.0),
    )  # fmt: skip
    return bw.Scene(
        balloon=[ball], obstacle=obstacles, ground=bw.Ground(height=-2.6, friction=0.0), frames=max(FRAMES),
        substeps=16, faces=False,
    )  # fmt: skip


def _center(moved: bw.Trajectories) -> tuple[Any, dict[str, Any]]:
    points = moved.points[0]
    slopes = np.zeros(points.shape)
    slopes[-1, :, 0] = 1.0 / points.shape[1]
    return float(points[-1, :, 0].mean(dtype=float)), {"points": [slopes]}


def _differences(of: bw.Scene) -> list[np.ndarray]:
    """Return central differences over each reach, of all frames."""
    sides = np.array([sign * reach for reach in REACHES for sign in (1.0, -1.0)])
    moved = bw.simulate(of, world_count=len(sides), vary={PATH: sides}, device="cpu")
    centers = moved.points[0][..., 0].mean(axis=2, dtype=float)
    return [(centers[2 * n] - centers[2 * n + 1]) / (2.0 * reach) for n, reach in enumerate(REACHES)]

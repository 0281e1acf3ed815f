"""Bundled scenes, simulated once for all tests."""

from dataclasses import replace
from functools import cache

import numpy as np

from balloon_warp import Frame, PolygonMesh, Simulator, load_scene
from balloon_warp.model import Model
from balloon_warp.scene.load import Override

BRISKLY: dict[str, tuple[Override, ...]] = {
    "balloon_pit": (("frames", 160),),
    "pop": (("balloon.0.mesh", "ball.obj"), ("balloon.1.mesh", "ball.obj"), ("frames", 520)),
}
"""values that make scenes that take a minute shorter: frames in which all lies still; and a coarser mesh, whose pieces
lie as well (test_burst_outputs.py bursts the fine one)"""


@cache
def played(name: str, overrides: tuple[Override, ...] = ()) -> tuple[Model, list[Frame]]:
    simulator, frames, _ = _simulated(name, overrides)
    return simulator.model, frames


def most_held(name: str) -> int:
    """Return the largest number of particles in any frame that a sharp edge holds."""
    return max(_simulated(name, ())[2])


@cache
def _simulated(name: str, overrides: tuple[Override, ...]) -> tuple[Simulator, list[Frame], list[int]]:
    """Return the simulator, its frames, and how many particles are held in each."""
    simulator, frames, held = Simulator(load_scene(name, (*BRISKLY.get(name, ()), *overrides)), "cpu"), [], []
    for frame in simulator.run():
        frames.append(frame)
        held.append(int((simulator.state.holds.numpy()[0, :, 3] != 0.0).sum()))
    return simulator, frames, held


def shape_at(model: Model, frame: Frame, balloon: int = 0) -> PolygonMesh:
    return replace(model.shapes[balloon].mesh, points=frame.points[balloon].astype(np.float64))


def stretches(model: Model, frame: Frame) -> np.ndarray:
    """Return length over rest length of the springs."""
    springs = model.shapes[0].springs
    first, second = frame.points[0].astype(np.float64)[springs.pairs].swapaxes(0, 1)
    return np.linalg.norm(second - first, axis=1) / springs.rest_lengths

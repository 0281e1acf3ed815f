"""Scenes whose worlds begin anew, and their states."""

import numpy as np
from meshes import quad_sphere
from trajectories import stepped

from balloon_warp import Balloon, Body, Ground, Inflation, Scene, Simulator, Sphere

BALL = Balloon(mesh=quad_sphere(3, 0.5), inflation=Inflation(pressure=5.0), velocity=(0.0, -1.0, 0.0))
GAS = Balloon(mesh=quad_sphere(3, 0.4), position=(0.0, 1.1, 0.0), inflation=Inflation(kind="gas"))
TOUCHING = Scene(
    balloon=[BALL, GAS],
    sphere=[Sphere(position=(0.0, -0.9, 0.0), radius=0.35)],
    body=[Body(shape="box", size=(0.2, 0.2, 0.2), position=(2.0, 1.0, 0.0))],
    ground=Ground(height=-1.3),
    contacts=True,
)
ALONE = Scene(balloon=[BALL], substeps=24)


def arrays(simulator: Simulator) -> dict[str, np.ndarray]:
    return {name: array.numpy().copy() for name, array in simulator.state.arrays.items() if name != "frame"}


def begun_anew(scene: Scene, schedule: str, resets: tuple[int, ...], frames: int) -> tuple[Simulator, ...]:
    """Require that a world that begins anew is, bit for bit, as one that begins, while the other goes on.

    Args:
        resets: Frames before each of the times that the second world begins anew.
        frames: Those after the last.

    Returns: Two worlds that only went on, two of which the second began anew, and one that only began."""
    whole, masked = (Simulator(scene, "cpu", 2, schedule=schedule) for _ in range(2))
    stepped(whole, sum(resets) + frames)
    for before in resets:
        stepped(masked, before).reset([0, 1])
    stepped(masked, frames)
    fresh = stepped(Simulator(scene, "cpu", 1, schedule=schedule), frames)
    require_same(masked, fresh, slice(1, 2))
    require_same(masked, whole, slice(0, 1), slice(0, 1))
    return whole, masked, fresh


def require_same(found: Simulator, expected: Simulator, of: slice = slice(None), like: slice = slice(None)) -> None:
    """Require the same states, bit for bit, of some worlds of one simulator and another."""
    other = arrays(expected)
    for name, array in arrays(found).items():
        np.testing.assert_array_equal(array[of], other[name][like], err_msg=name)

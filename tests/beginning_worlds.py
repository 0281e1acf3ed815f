"""Scenes whose worlds begin anew, and what they come to."""

import numpy as np
from meshes import quad_sphere

from balloon_warp import Simulator
from balloon_warp.scene import Balloon, Body, Ground, Inflation, Scene, Sphere

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

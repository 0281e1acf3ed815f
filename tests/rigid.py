"""Scenes of free rigid bodies, which tests share, and their conserved quantities."""

from typing import Any

import conserved
import numpy as np
from meshes import cube
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from balloon_warp import Atmosphere, Balloon, Body, Ground, Inflation, Scene, Simulator

EPSILON = float(np.finfo(np.float32).eps)
SPACE: dict[str, Any] = {"gravity": 0.0, "atmosphere": Atmosphere(density=0.0), "ground": Ground(height=-90.0)}
"""Fields of a scene in which nothing acts: the ground, far below, is there for the kernels of scenes that have one"""


def scene_of(*bodies: Body, **fields: Any) -> Scene:
    """Return bodies, and a balloon that is far away and stays there."""
    away = Balloon(mesh=cube(), position=(0, 90.0, 0), inflation=Inflation(k_normal=0.0), fixed=list(range(8)))
    return Scene(**{"balloon": [away], "body": list(bodies), "frames_per_second": 100.0, "substeps": 10} | fields)


def started(device: str, *bodies: Body, schedule: str = "gather", **fields: Any) -> Simulator:
    return Simulator(scene_of(*bodies, **fields), device, schedule=schedule)


def body_state(simulator: Simulator, name: str, world: int = 0) -> NDArray[np.float64]:
    """Return a state of the bodies of a world, shape (body_count, 3 or 4)."""
    return getattr(simulator.state, f"body_{name}").numpy()[world].astype(float)


def body_masses(simulator: Simulator) -> NDArray[np.float64]:
    return simulator.model.parameters["body_mass"].numpy()[0].astype(float)


def tensors(simulator: Simulator, world: int = 0) -> NDArray[np.float64]:
    """Return the inertia tensors in the axes of the world [kg m^2], shape (body_count, 3, 3)."""
    turns = Rotation.from_quat(body_state(simulator, "turns", world)).as_matrix()
    inertias = np.reshape([shape.inertia for shape in simulator.model.bodies], (-1, 3, 3))
    own = inertias * body_masses(simulator)[:, None, None]
    return turns @ own @ turns.swapaxes(1, 2)


def kinetic(simulator: Simulator, world: int = 0, beside: float = 0.0) -> float:
    """Return the kinetic energy of the bodies [J], beside a frame that moves along x [m/s]."""
    velocities, momenta = (body_state(simulator, name, world) for name in ("velocities", "momenta"))
    velocities = velocities - (beside, 0.0, 0.0)
    turning = sum(float(m @ np.linalg.solve(t, m)) for m, t in zip(momenta, tensors(simulator, world), strict=True))
    return 0.5 * float(body_masses(simulator) @ (velocities**2).sum(axis=1)) + 0.5 * turning


def body_energy(simulator: Simulator, gravity: float = 9.81) -> float:
    """Return the energy of the bodies' motion and weight [J]; the y axis is up."""
    return kinetic(simulator) + gravity * float(body_masses(simulator) @ body_state(simulator, "positions")[:, 1])


def moved(simulator: Simulator, start: Simulator) -> tuple[float, float]:
    """Return the largest distance [m] and turn [degrees] of any body from its start in another."""
    ways = body_state(simulator, "positions") - body_state(start, "positions")
    turns = Rotation.from_quat(body_state(simulator, "turns")) * Rotation.from_quat(body_state(start, "turns")).inv()
    return float(np.linalg.norm(ways, axis=1).max()), float(np.degrees(turns.magnitude().max()))


def whole(simulator: Simulator) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return momentum, angular momentum and energy of balloons, bodies and spheres."""
    own = body_masses(simulator)[:, None] * body_state(simulator, "velocities")
    about = np.cross(body_state(simulator, "positions"), own) + body_state(simulator, "momenta")
    total, turning, energy = conserved.whole(simulator)
    return total + own.sum(axis=0), turning + about.sum(axis=0), energy + kinetic(simulator)

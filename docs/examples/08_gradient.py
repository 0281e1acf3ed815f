"""Stiffness and pressure of a balloon, found from its motion by gradients.

A ball that is let go swells and falls. From its particles' places alone, SciPy finds the stiffness of its
springs and its pressure: the gradient says which way to go, in one run however many numbers are unknown.
"""

import numpy as np
from scipy.optimize import minimize
from trimesh.creation import icosphere

import balloon_warp as bw

FRAMES = 8
TRUE = np.array([90.0, 60.0])  # [N/m], [Pa]
GUESS = np.array([60.0, 40.0])
OF = ["balloon.stiffness.structural", "balloon.inflation.pressure"]

ball = bw.Balloon(
    mesh=icosphere(subdivisions=1, radius=0.22), mass=0.2, damping=0.05, inflation=bw.Inflation(pressure=60.0)
)
scene = bw.Scene(balloon=[ball], frames=FRAMES, substeps=24)


def with_values(values: np.ndarray) -> bw.Scene:
    """Put values where they stand in the scene."""
    return bw.load_scene(scene, dict(zip(OF, values.tolist(), strict=True)))


measured = bw.simulate(with_values(TRUE)).points[0]


def misfit(scales: np.ndarray) -> tuple[float, np.ndarray]:
    """Return how far particles are from where they were measured, and how that grows with each value."""

    def loss(moved: bw.Trajectories) -> tuple[float, dict[str, list[np.ndarray]]]:
        off = moved.points[0].astype(float) - measured
        return 100.0 * (off**2).sum(), {"points": [200.0 * off]}

    found = bw.gradient(with_values(scales * GUESS), of=OF, loss=loss)
    return found.loss[0], np.array([found.gradients[path][0] for path in OF]) * GUESS


best = minimize(misfit, np.ones(2), jac=True, method="L-BFGS-B")
values = best.x * GUESS
for path, value, true in zip(OF, values, TRUE, strict=True):
    print(f"{path}: {value:.4g}, and was {true:g}")
print(f"{best.nfev} gradients")

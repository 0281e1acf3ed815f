"""Largest pressure of a sealed gas at which the step of a balloon is stable."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import vertex_vector_areas
from balloon_warp.model.spectrum import largest_eigenvalue

PART = 0.5
"""Part of the stiffness that a step bears, 1 / h^2 of the mass, that may be the gas's: a skin four times as long as at
the start has four times as much, and its springs have the rest. Coarse balls of springs need 0.2 at their limit point
"""
TURNS = 15
"""Number of Lanczos iterations, for an error of some percent"""
ALL = 1.0e30
"""Bound of a balloon without faces to turn"""


def pressure_bound(mesh: PolygonMesh, mass_share: NDArray[np.float64]) -> float:
    """Return the largest gauge pressure of a gas in a balloon, over its mass and times the step squared [1/m].

    A pressure pushes particles along the gradient of the volume, which turns with the skin. So it is as stiff as p H, H
    the volume's Hessian [m], along the skin and across it; only the growth of the volume as a whole is taken
    implicitly. Explicitly that is stable while p times the largest eigenvalue of M^-1 H is well below 4 / h^2.

    Args:
        mesh: whose faces enclose the gas.
        mass_share: of each particle; 0 of fixed ones.
    """
    moves = mass_share > 0.0
    roots = np.sqrt(np.divide(1.0, mass_share, out=np.zeros(len(moves)), where=moves))[:, None]
    points = mesh.points - mesh.points.mean(axis=0)

    def slopes(vector: NDArray[np.float64]) -> NDArray[np.float64]:
        moved = roots * vector.reshape(-1, 3)
        ends = [vertex_vector_areas(replace(mesh, points=points + sign * moved)) for sign in (1.0, -1.0)]
        return (0.5 * roots * (ends[1] - ends[0])).ravel()  # exact: areas are of second degree

    start = moves[:, None] * np.random.default_rng(0).normal(size=points.shape)
    largest = largest_eigenvalue(slopes, start.ravel(), TURNS) if moves.any() else 0.0
    return PART / largest if largest > 0.0 else ALL

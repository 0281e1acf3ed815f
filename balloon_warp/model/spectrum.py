"""Highest frequency of a network of springs, and the gas pressure at which a step is stable."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import vertex_vector_areas

Vector = NDArray[np.float64]
TURNS = 40
"""Number of Lanczos iterations: from a random start the expected error is at most 0.103 (ln n / 39)^2 of the largest
eigenvalue, downward, for any matrix (Kuczynski and Wozniakowski 1992): 0.4% for 2,500 particles"""
MARGIN = 1.01
"""Factor on the estimate, so that it is not too low"""
FEW = 100
"""Number of particles up to which all eigenvalues are computed exactly"""


def highest_squared_frequency(
    pairs: NDArray[np.integer],
    constants: NDArray[np.float64],
    held: NDArray[np.float64],
    masses: NDArray[np.float64],
) -> float:
    """Return the largest eigenvalue of M^-1 K [1/s^2], or up to 1% more; 0 if nothing moves.

    K is the Laplacian of the springs, weighted with their constants, and more on its diagonal. In no state of the
    springs, in no direction, are they stiffer: each has at most its constant, along it.

    Args:
        pairs: of particles, shape (springs, 2).
        constants: of the springs [N/m], shape (springs,).
        held: other stiffness that pulls a particle back to its place, shape (particles,) [N/m].
        masses: 0 of fixed particles [kg], shape (particles,).
    """
    count = len(masses)
    roots = np.sqrt(np.divide(1.0, masses, out=np.zeros(count), where=masses > 0.0))
    first, second = pairs[:, 0], pairs[:, 1]
    diagonal = held + np.bincount(first, constants, count) + np.bincount(second, constants, count)

    def times(vector: Vector) -> Vector:
        moved = roots * vector
        pulls = np.bincount(first, constants * moved[second], count)
        pulls += np.bincount(second, constants * moved[first], count)
        return roots * (diagonal * moved - pulls)

    if np.count_nonzero(roots) <= FEW:
        moving = np.flatnonzero(roots)
        columns = [times(unit)[moving] for unit in np.eye(count)[moving]]
        return float(np.linalg.eigvalsh(np.array(columns)).max(initial=0.0)) if columns else 0.0
    return MARGIN * largest_eigenvalue(times, np.where(roots > 0.0, np.random.default_rng(0).normal(size=count), 0.0))


def largest_eigenvalue(times: Callable[[Vector], Vector], start: Vector, turns: int = TURNS) -> float:
    """Return the largest eigenvalue of a symmetric matrix by Lanczos, without reorthogonalization.

    Reorthogonalization would change the copies of the largest eigenvalue, and not the value.

    Args:
        times: Product of the matrix and a vector.
        start: Vector with a part in all that counts.
        turns: Number of iterations.
    """
    before, vector = np.zeros_like(start), start / np.linalg.norm(start)
    diagonal, beside = [], [0.0]
    for _ in range(turns):
        image = times(vector) - beside[-1] * before
        diagonal.append(float(image @ vector))
        image -= diagonal[-1] * vector
        beside.append(float(np.linalg.norm(image)))
        if beside[-1] <= 1e-12 * abs(diagonal[0]):
            break  # all that the start has
        before, vector = vector, image / beside[-1]
    inner = beside[1 : len(diagonal)]
    return float(np.linalg.eigvalsh(np.diag(diagonal) + np.diag(inner, 1) + np.diag(inner, -1)).max())


PART = 0.5
"""Part of the stiffness that a step bears, 1 / h^2 of the mass, that may be the gas's: a skin four times as long as at
the start has four times as much, and its springs have the rest. Coarse balls of springs need 0.2 at their limit point
"""
HALVINGS = 15
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
    largest = largest_eigenvalue(slopes, start.ravel(), HALVINGS) if moves.any() else 0.0
    return PART / largest if largest > 0.0 else ALL

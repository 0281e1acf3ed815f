"""The highest frequency of a network of springs."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

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

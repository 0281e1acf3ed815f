"""A smooth step towards the wanted shape: Gauss and Newton's, by conjugate gradients.

    least |W (e - K^-1 B S y)|^2 + damping |y|^2 + |P (gap - least)|^2 where gaps would be too narrow

S smooths, so that changes of single vertices cost more than those of whole regions. Each product takes two solutions
with the factorized stiffness K, and the more damping, the fewer products are needed.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, cg, splu

from balloon_warp.lab.design.descent import Response
from balloon_warp.lab.design.target import Gaps

Values = NDArray[np.float64]
REACH, ALONE = 3.0, 0.05
"""Distance over which changes are smooth, in edges, and the unsmoothed fraction"""
EXACT, MOST_PRODUCTS = 0.01, 80
"""Relative residual of the normal equations, and the most products with their matrix"""
POWERS = 3
"""Number of products by which their largest eigenvalue is found, roughly"""
MOST_SOLVED, MISSED = 4, 0.9
"""Number of times that a step is solved with ever more gaps, and the part of the least width below which they count"""


class Smoothing:
    """Smoothing of values at the vertices of a mesh, (1 + r^2 L)^-1 plus a part that is not smooth."""

    def __init__(self, ends: NDArray[Any], count: int):
        ones = np.ones(len(ends))
        beside = sparse.coo_matrix((ones, (ends[:, 0], ends[:, 1])), shape=(count, count))
        beside = beside + beside.T
        valences = np.asarray(beside.sum(axis=1)).ravel()
        laplacian = (sparse.diags(valences) - beside) / valences.mean()
        self._solve = splu((sparse.identity(count) + REACH**2 * laplacian).tocsc()).solve
        self._count = count

    def __call__(self, values: Values) -> Values:
        """Smooth vectors of all vertices, which may be followed by a number of each, shape (3 n,) or (4 n,)."""
        moves, more = values[: 3 * self._count].reshape(-1, 3), values[3 * self._count :].reshape(self._count, -1)
        together = np.hstack([moves, more])
        smooth = self._solve(together) + ALONE * together
        return np.concatenate([smooth[:, :3].ravel(), smooth[:, 3:].ravel()])


@dataclass(frozen=True)
class SmoothAim:
    """Aim of a smooth step."""

    error: Values
    """Vectors from the particles to where they should be [m], shape (n, 3)"""
    weights: Any
    """W'W, shape (3 n, 3 n)"""
    smoothing: Smoothing
    scales: Values
    """Magnitudes of easy changes of each number of the design, shape (m,)"""
    gaps: Gaps
    damping: float
    """Damping, in a unit in which 1 is much"""


def smooth_step(response: Response, aim: SmoothAim) -> Values:
    """Return the change of the design, shape (m,)."""
    step = _Step(response, aim, aim.gaps.widths < aim.gaps.least)
    for _ in range(MOST_SOLVED):
        step = step.solved()
        more = step.missed() & ~step.active
        if not more.any():
            break
        step = replace(step, active=step.active | more)
    return step.change


@dataclass(frozen=True)
class _Step:
    """Normal equations of a step, and their solution with some of the gaps."""

    response: Response
    aim: SmoothAim
    active: NDArray[np.bool_]
    """Mask of the gaps that are kept open, shape (k,)"""
    unit: float = 0.0
    """Largest eigenvalue without damping, roughly"""
    found: Values | None = None

    @property
    def change(self) -> Values:
        """Change of the design, shape (m,)."""
        assert self.found is not None
        return self._easily(self.found)

    def missed(self) -> NDArray[np.bool_]:
        """Return the gaps that would be too narrow, shape (k,)."""
        gaps, moved = self.aim.gaps, self.change[: self.aim.error.size]
        return np.asarray(gaps.widths + gaps.widening @ moved < MISSED * gaps.least)

    def solved(self) -> "_Step":
        """Return the step with its solution."""
        aim, gaps = self.aim, self.aim.gaps
        wanted = self._back(self.response.transposed(aim.weights @ aim.error.ravel()))
        unit = self.unit or self._largest(wanted)
        wanted = wanted + self._of_gaps(gaps.least - gaps.widths)

        def times(vector: Values) -> Values:
            damped = self._squared(vector) + aim.damping * unit * vector
            return damped + self._of_gaps(gaps.widening @ self._easily(vector)[: aim.error.size])

        size = len(wanted)
        matrix = LinearOperator((size, size), matvec=times, dtype=np.float64)  # pyright: ignore
        found, _ = cg(matrix, wanted, x0=self.found, rtol=EXACT, maxiter=MOST_PRODUCTS)
        return replace(self, unit=unit, found=found)

    def _largest(self, vector: Values) -> float:
        """Return the largest eigenvalue of the equations without damping and gaps, roughly."""
        largest = 0.0
        for _ in range(POWERS):
            vector = vector / max(float(np.linalg.norm(vector)), 1.0e-300)
            product = self._squared(vector)
            largest, vector = float(np.linalg.norm(product)), product
        return max(largest, 1.0e-300)

    def _squared(self, vector: Values) -> Values:
        moves = self.response.moves(self._easily(vector))
        return self._back(self.response.transposed(self.aim.weights @ moves))

    def _of_gaps(self, widths: Values) -> Values:
        """Return the transposed derivatives of the gaps that are kept open, weighted, times widths, shape (m,)."""
        gaps = self.aim.gaps
        moves = gaps.widening.T @ (gaps.weights * self.active * widths)
        return self._back(np.append(moves, np.zeros(len(self.aim.scales) - len(moves))))

    def _easily(self, vector: Values) -> Values:
        """Return S y."""
        return self.aim.scales * self.aim.smoothing(vector)

    def _back(self, vector: Values) -> Values:
        """Return S' v."""
        return self.aim.smoothing(self.aim.scales * vector)

"""Linear systems of a balance: a sparse stiffness, and the gas's, which is a product of two vectors."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

Values = NDArray[np.float64]
Solve = Callable[[Values], Values]
NUDGES = (1.0e-12, 1.0e-9, 1.0e-6)
"""Shifts over the largest entry, added where a matrix is singular"""


@dataclass(frozen=True)
class Stiffness:
    """A sparse matrix plus s g g', which is not sparse."""

    matrix: Any
    """Sparse part [N/m], shape (m, m)"""
    slopes: Values
    """g: slopes of the volume [m^2], shape (m,)"""
    squeeze: float
    """s: how the gas stiffens as it is squeezed [Pa/m^3]"""

    def solver(self) -> Solve:
        """Return a solver of systems with it (Sherman and Morrison)."""
        solve = solver_of(self.matrix)
        through = solve(self.slopes)
        share = self.squeeze / (1.0 + self.squeeze * (self.slopes @ through))

        def solved(vector: Values) -> Values:
            plain = solve(vector)
            return plain - through * (share * (self.slopes @ plain))

        return solved


def solver_of(matrix: Any) -> Solve:
    """Return a solver of linear systems with a matrix of a symmetric pattern, or with one near it if it is singular."""
    unit = float(np.abs(matrix).max())
    for share in (0.0, *NUDGES):
        try:
            factor = splu(
                (shifted(matrix, share * unit) if share else matrix).tocsc(), permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.001, options={"SymmetricMode": True},
            )  # fmt: skip
            return factor.solve
        except RuntimeError:  # singular, as that of coarse or folded meshes may be
            continue
    return np.zeros_like


def shifted(matrix: Any, by: float) -> Any:
    """Return a matrix with more on its diagonal."""
    return matrix + by * sparse.identity(matrix.shape[0], format="csc")

"""Response of a balloon at rest to changes of its design."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from balloon_warp.designing.newton import HOLD
from balloon_warp.statics.balance import Balance
from balloon_warp.statics.systems import Solve, Stiffness, shifted

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Response:
    """Linear response dx = K^-1 B dq: the stiffness is factorized once, for any number of changes."""

    by_design: Any
    """B, over the mean stiffness, shape (3 n, m)"""
    solve: Solve
    """Solver of systems with K, over the mean stiffness"""

    @classmethod
    def of(cls, balance: Balance, points: Values, by_design: sparse.csc_matrix) -> "Response":
        """Factorize the stiffness of a balloon at rest.

        Args:
            points: at rest [m], shape (n, 3).
            by_design: B, the derivatives of the forces by the design, shape (3 n, m).
        """
        stiff, slopes, squeeze = balance.stiffness(points)
        if balance.loading:
            by_design = sparse.csc_matrix(sparse.diags(balance.loading.free) @ by_design)
        unit = float(np.abs(stiff.diagonal()).mean())
        return cls(by_design / unit, Stiffness(shifted(stiff / unit, HOLD), slopes, squeeze / unit).solver())

    def moves(self, change: Values) -> Values:
        """Return how the particles move where the design changes, shape (3 n,)."""
        return self.solve(self.by_design @ change)

    def transposed(self, moves: Values) -> Values:
        """Return the transposed operator's product with moves, shape (m,)."""
        return np.asarray(self.by_design.T @ self.solve(moves))

"""A step towards the wanted shape: Gauss and Newton's, through the balance.

A step towards the wanted shape: Gauss and Newton's, through the balance.

At rest the forces vanish for every design: K dx = B dq, where K is the stiffness of skin and gas, and B the derivative
of the forces by the design. So no gradient through time is needed: one sparse system gives the step of the design that
brings the balance nearest to the wanted shape, and changes the design least (Levenberg and Marquardt):

    least |W (e - dx)|^2 + damping |y|^2   with   K dx = B dq,  dq = S y
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from balloon_warp.statics.balance import Balance, Solve, Stiffness, shifted, solver_of

Values = NDArray[np.float64]
HOLD = 1.0e-7
"""Regularization against rigid motion, over the mean stiffness"""


@dataclass(frozen=True)
class Aim:
    """Aim of a step."""

    error: Values
    """Vectors from the particles to where they should be [m], shape (n, 3)"""
    weights: Any
    """W'W, shape (3 n, 3 n)"""
    easily: Any
    """S: directions in which the design changes easily, as columns, scaled by how much, shape (m, k)"""
    damping: float
    """Damping, in a unit in which 1 is much"""


def step_towards(balance: Balance, points: Values, by_design: sparse.csc_matrix, aim: Aim) -> Values:
    """Return the change of the design, shape (m,).

    Args:
        points: at rest, shape (n, 3).
        by_design: B, the derivatives of the forces by the design, shape (3 n, m).
    """
    stiff, slopes, squeeze = balance.stiffness(points)
    if balance.loading:
        by_design = sparse.csc_matrix(sparse.diags(balance.loading.free) @ by_design)
    count, unit = len(slopes), float(np.abs(stiff.diagonal()).mean())
    stiff = (stiff + HOLD * unit * sparse.identity(count)) / unit
    gives = by_design @ aim.easily / unit  # B S
    reached = gives @ gives.T
    share = aim.damping * float(reached.diagonal().mean())
    reached = reached / share + HOLD**2 * sparse.identity(count)
    matrix = sparse.bmat([[aim.weights, stiff], [stiff, -reached]], format="csc")
    wanted = np.concatenate([aim.weights @ aim.error.ravel(), np.zeros(count)])
    solved = _with_gas(solver_of(matrix), wanted, slopes, squeeze / unit)
    return aim.easily @ (gives.T @ solved[count:]) / share


def _with_gas(solve: Callable[[Values], Values], wanted: Values, slopes: Values, squeeze: float) -> Values:
    """Solve where the gas adds s (a b' + b a') to the matrix, for it adds s g g' to K (Woodbury)."""
    none = np.zeros_like(slopes)
    columns = np.stack([np.append(slopes, none), np.append(none, slopes)], axis=1)
    plain, through = solve(wanted), solve(columns)
    rows = squeeze * columns[:, ::-1].T
    return plain - through @ np.linalg.solve(np.eye(2) + rows @ through, rows @ plain)


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

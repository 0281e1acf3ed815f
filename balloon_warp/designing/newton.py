"""A step towards the wanted shape: Gauss and Newton's, through the balance.

At rest the forces vanish, whatever the design: K dx = B dq, where K is the stiffness of skin and gas, and B what the
design does to the forces. So no gradient through time is needed: one sparse system gives the step of the design that
brings the balance nearest to what is wanted, and changes the design least (Levenberg and Marquardt):

    least |W (e - dx)|^2 + damping |R dq|^2   with   K dx = B dq
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from balloon_warp.statics.balance import Balance, solver_of

Values = NDArray[np.float64]
HOLD = 1.0e-7
"""of the mean stiffness, which holds what could move along and turn"""


@dataclass(frozen=True)
class Aim:
    """What is wanted of a step."""

    error: Values
    """where the particles should be, from where they are [m], shape (n, 3)"""
    weights: sparse.spmatrix
    """W'W, shape (3 n, 3 n)"""
    cost: Values
    """R'R: what it costs to change each number of the design, shape (m,)"""
    damping: float
    """times a unit that makes 1 much"""


def step_towards(balance: Balance, points: Values, by_design: sparse.csc_matrix, aim: Aim) -> Values:
    """The change of the design, shape (m,).

    Args:
        points: at rest, shape (n, 3).
        by_design: B, the derivatives of the forces by the design, shape (3 n, m).
    """
    stiff, slopes, squeeze = balance.stiffness(points)
    count, unit = len(slopes), float(np.abs(stiff.diagonal()).mean())
    stiff = (stiff + HOLD * unit * sparse.identity(count)) / unit
    gives = by_design @ sparse.diags(1.0 / aim.cost) / unit
    reached = gives @ by_design.T / unit  # B (R'R)^-1 B'
    reached = reached / (aim.damping * reached.diagonal().mean()) + HOLD**2 * sparse.identity(count)
    matrix = sparse.bmat([[aim.weights, stiff], [stiff, -reached]], format="csc")
    wanted = np.concatenate([aim.weights @ aim.error.ravel(), np.zeros(count)])
    solved = _with_gas(solver_of(matrix), wanted, slopes, squeeze / unit)
    share = float((gives @ by_design.T / unit).diagonal().mean()) * aim.damping
    return (gives.T @ solved[count:]) / share


def _with_gas(solve: Callable[[Values], Values], wanted: Values, slopes: Values, squeeze: float) -> Values:
    """Solve where the gas adds s (a b' + b a') to the matrix, for it adds s g g' to K (Woodbury)."""
    none = np.zeros_like(slopes)
    columns = np.stack([np.append(slopes, none), np.append(none, slopes)], axis=1)
    plain, through = solve(wanted), solve(columns)
    rows = squeeze * columns[:, ::-1].T
    return plain - through @ np.linalg.solve(np.eye(2) + rows @ through, rows @ plain)

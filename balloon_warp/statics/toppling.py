"""Stability of an equilibrium: Newton's method keeps symmetries, and may so end at a saddle of the energy."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.statics.balance import Balance
from balloon_warp.statics.systems import Stiffness, shifted

Values = NDArray[np.float64]
HOLD = 1.0e-7
"""Shift over the mean stiffness, against singular matrices"""
PRODUCTS = 20
"""Number of products with the inverse stiffness by which its softest mode is found"""
UNSTABLE = -1.0e-5
"""Stiffness of a mode below which it topples, over the mean: the tension field leaves rounding errors"""


def toppling_mode(balance: Balance, points: Values) -> Values | None:
    """Return the mode in which an equilibrium is unstable, of length 1, shape (n, 3); None where it is stable.

    Only the softest mode is tested, which is the first to become unstable.
    """
    stiff, slopes, squeeze = balance.stiffness(points)
    unit = float(np.abs(stiff.diagonal()).mean())
    solve = Stiffness(shifted(stiff / unit, HOLD), slopes, squeeze / unit).solver()
    rigid = np.zeros((points.size, 0)) if balance.loading else rigid_motions(points)
    mode = np.random.default_rng(0).standard_normal(points.size)
    for _ in range(PRODUCTS):
        mode = solve(mode - rigid @ (rigid.T @ mode))
        mode -= rigid @ (rigid.T @ mode)
        mode /= max(float(np.linalg.norm(mode)), 1.0e-300)
    stiffness = mode @ (stiff @ mode) / unit + squeeze / unit * (slopes @ mode) ** 2
    return mode.reshape(-1, 3) if stiffness < UNSTABLE else None


def rigid_motions(points: Values) -> Values:
    """Return an orthonormal basis of small moves and turns, shape (3 n, 6)."""
    away = points - points.mean(axis=0)
    moves = [np.broadcast_to(axis, points.shape) for axis in np.eye(3)]
    turns = [np.cross(axis, away) for axis in np.eye(3)]
    return np.linalg.qr(np.array([each.ravel() for each in (*moves, *turns)]).T)[0]

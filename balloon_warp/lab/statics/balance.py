"""Equilibrium of a balloon by Newton's method, and its stability."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from balloon_warp.lab.statics.skins import SealedGas, Volume

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


MOST_STEPS = 100
STILL = 1.0e-7
"""Largest residual force at rest over the forces of the gas"""
FIRST_SHIFT, LEAST_SHIFT, MOST_SHIFT = 1.0e-4, 1.0e-9, 1.0e4
"""Shifts over the mean stiffness, added where the energy is not convex; they also restrain rigid motion"""


class Skin(Protocol):
    """Skin of springs or of a film."""

    def energy(self, points: Values) -> float:
        """Return the energy [J]."""
        ...

    def forces(self, points: Values) -> Values:
        """Return the forces on the particles [N], shape (n, 3)."""
        ...

    def stiffness(self, points: Values) -> sparse.csc_matrix:
        """Return minus the derivatives of the forces [N/m], shape (3 n, 3 n)."""
        ...


@dataclass(frozen=True)
class Loading:
    """Dead loads, and the particles that are held against them."""

    forces: Values
    """Loads that act whatever the shape is [N], shape (n, 3)"""
    held: NDArray[np.bool_]
    """Mask of the fixed particles, shape (n,)"""

    @cached_property
    def free(self) -> Values:
        """1 for each coordinate that may change, else 0, shape (3 n,)."""
        return np.repeat(np.where(self.held, 0.0, 1.0), 3)

    def of_free(self, forces: Values) -> Values:
        """Return forces with the loads, and none on held particles, shape (n, 3)."""
        return np.where(self.held[:, None], 0.0, forces + self.forces)

    def work(self, way: Values) -> float:
        """Return the work of the loads along a way of the particles [J]."""
        return float((self.forces * way).sum())

    def stiffness(self, matrix: Any) -> Any:
        """Return a stiffness matrix in which held particles are coupled to nothing."""
        free, unit = sparse.diags(self.free), float(np.abs(matrix.diagonal()).mean())
        return free @ matrix @ free + unit * sparse.diags(1.0 - self.free)


@dataclass(frozen=True)
class Balance:
    """A skin around a sealed gas, free or loaded and held."""

    skin: Any
    volume: Volume
    gas: SealedGas
    loading: Loading | None = None

    def forces(self, points: Values) -> Values:
        """Return the forces of skin, gas and loads on the particles that may move [N], shape (n, 3)."""
        forces = self.skin.forces(points) + self.pressure(points) * self.volume.slopes(points)
        return self.loading.of_free(forces) if self.loading else forces

    def pressure(self, points: Values) -> float:
        """Return the gauge pressure of the gas [Pa]."""
        return self.gas.pressure(self.volume.of(points))

    def stiffness(self, points: Values) -> tuple[sparse.csc_matrix, Values, float]:
        """Return minus the derivatives of the forces [N/m]: a sparse matrix plus s g g', where the gas is squeezed.

        Returns:
            The sparse part, shape (3 n, 3 n); g, shape (3 n,); and s.
        """
        volume = self.volume.of(points)
        sparse_part = self.skin.stiffness(points) - self.gas.pressure(volume) * self.volume.curvature(points)
        slopes = self.volume.slopes(points).ravel()
        if self.loading:
            sparse_part, slopes = self.loading.stiffness(sparse_part), self.loading.free * slopes
        return sparse_part.tocsc(), slopes, self.gas.stiffness(volume)

    def left_over(self, points: Values) -> float:
        """Return the root mean square of the forces over that of the gas's."""
        of_gas = self.pressure(points) * self.volume.slopes(points)
        return float(np.linalg.norm(self.forces(points)) / max(float(np.linalg.norm(of_gas)), 1.0e-30))

    def settle(
        self, points: Values, still: float = STILL, strays: Callable[[Values], bool] = lambda points: False
    ) -> Values | None:
        """Return the equilibrium reached from a start, or None if none is found.

        The center and the turn of free balloons stay as they are, or nearly so.

        Args:
            still: largest `left_over` of an equilibrium.
            strays: says on the way whether it is not worth going on.
        """
        shift, here = FIRST_SHIFT, points
        for _ in range(MOST_STEPS):
            if strays(here):
                return None
            if self.left_over(here) < still:
                return here
            found = self._step(here, shift)
            if found is None:
                return None
            here, shift = found
        return here if self.left_over(here) < 100.0 * still else None

    def _step(self, points: Values, shift: float) -> tuple[Values, float] | None:
        """Return the next points, and the next shift; None where no step helps."""
        matrix, slopes, squeeze = self.stiffness(points)
        forces, before = self.forces(points).ravel(), self.volume.of(points)
        resting, unit = self.skin.energy(points), float(np.abs(matrix.diagonal()).mean())
        while shift <= MOST_SHIFT:
            along = Stiffness(shifted(matrix, shift * unit), slopes, squeeze).solver()(forces)
            if along @ forces > 0.0:
                for length in (1.0, 0.5, 0.2):
                    there = points + length * along.reshape(-1, 3)
                    volume = self.volume.of(there)
                    if volume <= 0.0:
                        continue
                    gained = self.skin.energy(there) - resting + self.gas.energy(volume, before)
                    gained -= self.loading.work(there - points) if self.loading else 0.0
                    least = 1.0e-4 * length * float(along @ forces)
                    rounding = 1.0e-13 * abs(resting)
                    if gained <= rounding - least or (gained <= rounding and self._calmer(there, forces)):
                        return there, max(shift / 10.0, LEAST_SHIFT) if length == 1.0 else shift
            shift *= 10.0
        return None

    def _calmer(self, points: Values, before: Values) -> bool:
        return float(np.linalg.norm(self.forces(points))) < float(np.linalg.norm(before))


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

"""Balloons of latex: the shape of the mould, which is what the rubber is at rest, and how thick it is."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from balloon_warp.designing.crossings import crossing_count
from balloon_warp.designing.hanging import Hanging
from balloon_warp.designing.measure import Ruler
from balloon_warp.designing.uncrossed import uncrossed
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import mesh_edges
from balloon_warp.statics.balance import Balance
from balloon_warp.statics.film import FilmSkin
from balloon_warp.statics.volume import SealedGas, Volume

Values = NDArray[np.float64]
PASSES, ALONE = 2, 0.05
"""Number of smoothing passes of a change of the mould, and the unsmoothed fraction"""
FURTHEST = 0.25
"""Largest displacement of a vertex in a step, over the mean edge of the mould"""

THICKENS = 0.25
"""Largest relative change of a thickness in a step"""


@dataclass(frozen=True)
class MouldProblem:
    """The places of a mould's vertices."""

    ruler: Ruler
    film: FilmSkin
    """Film with a mould that is the scaled-down target shape"""
    stretch: float
    hanging: Hanging | None = None
    """Gravity, and what holds the balloon against it"""

    @property
    def mesh(self) -> PolygonMesh:
        """The wanted shape."""
        return self.ruler.mesh

    @property
    def plain(self) -> Values:
        """The wanted shape made smaller, shape (3 n,)."""
        return (self.mesh.points / self.stretch).ravel()

    @cached_property
    def volume(self) -> Volume:
        """Volume of the mesh."""
        return Volume(self.mesh)

    @cached_property
    def gas(self) -> SealedGas:
        """Gas that fills the target shape, at the pressure that best balances the plain mould."""
        points, slopes = self.mesh.points, self.volume.slopes(self.mesh.points)
        forces = self.film.with_mould(self.plain.reshape(-1, 3)).forces(points)
        pressure = -(forces * slopes).sum() / (slopes * slopes).sum()
        return SealedGas.of(pressure, self.volume.of(points))

    def balance(self, design: Values) -> Balance:
        """Return the balloon of that mould."""
        return self.balance_of(self.film.with_mould(design.reshape(-1, 3)))

    def balance_of(self, film: FilmSkin) -> Balance:
        """Return the balloon of a film."""
        loading = self.hanging.loading(film, self._of_gas) if self.hanging else None
        return Balance(film, self.volume, self.gas, loading)

    def by_design(self, balance: Balance, points: Values) -> sparse.csc_matrix:
        """Return the derivatives of its forces by the mould."""
        forces = balance.skin.forces_by_mould(points)
        if self.hanging:
            forces += self.hanging.forces_by(balance.skin.volumes_by_mould(len(points)))
        return forces

    def easily(self, design: Values, stuck: NDArray[np.bool_]) -> sparse.spmatrix:
        """Return the easy changes: vertices move by fractions of an edge, together with their neighbors."""
        free = sparse.diags(np.where(stuck, 0.0, self._edge))
        return sparse.csc_matrix(free @ sparse.kron(self.together, sparse.identity(3)))

    def allowed(self, design: Values) -> bool:
        """Return whether the mould does not cross itself."""
        return not crossing_count(replace(self.mesh, points=design.reshape(-1, 3)))

    def changed(self, design: Values, change: Values) -> Values:
        """Return the mould with a change, none of whose vertices moves too far, or so far that it crosses itself."""
        moves = change.reshape(-1, 3)
        far = np.linalg.norm(moves, axis=1, keepdims=True)
        moves = moves * np.minimum(1.0, FURTHEST * self._edge / np.maximum(far, 1e-30))
        mould = replace(self.mesh, points=design.reshape(-1, 3))
        return design + uncrossed(mould, moves, self._means).ravel()

    @cached_property
    def together(self) -> Any:
        """Smooth changes, and a fraction of unsmoothed ones, shape (n, n)."""
        evened = self._means
        for _ in range(PASSES - 1):
            evened = evened @ self._means
        return (evened + ALONE * sparse.identity(self.mesh.vertex_count)).tocsc()

    @cached_property
    def _means(self) -> Any:
        """Means over a vertex and its neighbors, shape (n, n)."""
        ends, count = mesh_edges(self.mesh).ends, self.mesh.vertex_count
        both = np.concatenate([ends, ends[:, ::-1], np.stack([np.arange(count)] * 2, axis=1)])
        beside = sparse.coo_matrix((np.ones(len(both)), both.T), shape=(count, count)).tocsr()
        return sparse.diags(1.0 / np.asarray(beside.sum(axis=1)).ravel()) @ beside

    @cached_property
    def _of_gas(self) -> Values:
        """Return the loads of the gas's weight [N], shape (n, 3)."""
        assert self.hanging is not None
        return self.hanging.weight_of_air(self.gas, self.volume)

    @cached_property
    def _edge(self) -> float:
        ends, points = mesh_edges(self.mesh).ends, self.mesh.points / self.stretch
        return float(np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1).mean())


@dataclass(frozen=True)
class ThicknessProblem:
    """The places of a mould's vertices, and how thick the rubber is there."""

    mould: MouldProblem
    thickest: float
    """Largest thickness over that of the film, which is the least"""

    @property
    def ruler(self) -> Ruler:
        """Return the ruler of the wanted shape."""
        return self.mould.ruler

    def split(self, design: Values) -> tuple[Values, Values]:
        """Split a design into the mould, shape (3 n,), and the thickness at its vertices over the least, shape (n,)."""
        count = 3 * self.mould.mesh.vertex_count
        return design[:count], design[count:]

    def balance(self, design: Values) -> Balance:
        """Return the balance of the balloon of that mould and thickness."""
        mould, weights = self.split(design)
        return self.mould.balance_of(self.mould.film.with_mould(mould.reshape(-1, 3)).with_weights(weights))

    def by_design(self, balance: Balance, points: Values) -> sparse.csc_matrix:
        """Return the derivatives of its forces by both."""
        even = replace(balance.skin, skins=self.mould.film.skins)
        by_weights = even.forces_by_weights(points)
        if self.mould.hanging:
            by_weights += self.mould.hanging.forces_by(even.volumes_by_weights(len(points)))
        return sparse.csc_matrix(sparse.hstack([self.mould.by_design(balance, points), by_weights]))

    def easily(self, design: Values, stuck: NDArray[np.bool_]) -> sparse.spmatrix:
        """Return the easy changes: of the mould, and of the thickness by a fraction of itself, likewise smooth."""
        mould, weights = self.split(design)
        count = len(mould)
        free = sparse.diags(np.where(stuck[count:], 0.0, THICKENS * weights))
        parts = [self.mould.easily(mould, stuck[:count]), free @ self.mould.together]
        return sparse.csc_matrix(sparse.block_diag(parts))

    def allowed(self, design: Values) -> bool:
        """Return whether the mould does not cross itself."""
        return self.mould.allowed(self.split(design)[0])

    def changed(self, design: Values, change: Values) -> Values:
        """Return mould and thickness with a change, within bounds."""
        (mould, weights), (moves, thicker) = self.split(design), self.split(change)
        low, high = np.maximum(1.0, (1.0 - THICKENS) * weights), np.minimum(self.thickest, (1.0 + THICKENS) * weights)
        return np.concatenate([self.mould.changed(mould, moves), np.clip(weights + thicker, low, high)])

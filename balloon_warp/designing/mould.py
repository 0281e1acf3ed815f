"""Balloons of latex: the shape of the mould, which is what the rubber is at rest."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from balloon_warp.designing.measure import Ruler
from balloon_warp.designing.target import crossing_triangles
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


@dataclass(frozen=True)
class MouldProblem:
    """The places of a mould's vertices."""

    ruler: Ruler
    film: FilmSkin
    """Film with a mould that is the scaled-down target shape"""
    stretch: float

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
        return Balance(self.film.with_mould(design.reshape(-1, 3)), self.volume, self.gas)

    def by_design(self, balance: Balance, points: Values) -> sparse.csc_matrix:
        """Return the derivatives of its forces by the mould."""
        return balance.skin.forces_by_mould(points)

    def easily(self, design: Values, stuck: NDArray[np.bool_]) -> sparse.spmatrix:
        """Return the easy changes: vertices move by fractions of an edge, together with their neighbors."""
        return self._edge * self._together

    def allowed(self, design: Values) -> bool:
        """Return whether the mould does not cross itself."""
        return not len(crossing_triangles(replace(self.mesh, points=design.reshape(-1, 3))))

    def changed(self, design: Values, change: Values) -> Values:
        """Return the mould with a change, none of whose vertices moves too far."""
        moves = change.reshape(-1, 3)
        far = np.linalg.norm(moves, axis=1, keepdims=True)
        most = FURTHEST * self._edge
        return design + (moves * np.minimum(1.0, most / np.maximum(far, 1e-30))).ravel()

    @cached_property
    def _together(self) -> Any:
        """Smooth changes, and a fraction of unsmoothed ones, shape (3 n, 3 n)."""
        ends, count = mesh_edges(self.mesh).ends, self.mesh.vertex_count
        both = np.concatenate([ends, ends[:, ::-1], np.stack([np.arange(count)] * 2, axis=1)])
        beside = sparse.coo_matrix((np.ones(len(both)), both.T), shape=(count, count)).tocsr()
        mean = sparse.diags(1.0 / np.asarray(beside.sum(axis=1)).ravel()) @ beside
        evened = mean
        for _ in range(PASSES - 1):
            evened = evened @ mean
        return sparse.kron(evened + ALONE * sparse.identity(count), sparse.identity(3)).tocsc()

    @cached_property
    def _edge(self) -> float:
        ends, points = mesh_edges(self.mesh).ends, self.mesh.points / self.stretch
        return float(np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1).mean())

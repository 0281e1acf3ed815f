"""Balloons of latex: the shape of the mould, which is what the rubber is at rest."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from balloon_warp.designing.measure import Ruler
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import mesh_edges
from balloon_warp.statics.balance import Balance
from balloon_warp.statics.film import FilmSkin
from balloon_warp.statics.volume import SealedGas, Volume

Values = NDArray[np.float64]
FURTHEST = 0.25
"""of the mean edge of the mould is how far a vertex moves in a step"""


@dataclass(frozen=True)
class MouldProblem:
    """The places of a mould's vertices."""

    ruler: Ruler
    film: FilmSkin
    """of a mould that is the wanted shape made smaller"""
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
        """Of the mesh."""
        return Volume(self.mesh)

    @cached_property
    def gas(self) -> SealedGas:
        """What fills the wanted shape, at the pressure that the plain mould bears as well as it can."""
        points, slopes = self.mesh.points, self.volume.slopes(self.mesh.points)
        forces = self.film.with_mould(self.plain.reshape(-1, 3)).forces(points)
        pressure = -(forces * slopes).sum() / (slopes * slopes).sum()
        return SealedGas.of(pressure, self.volume.of(points))

    def balance(self, design: Values) -> Balance:
        """The balloon of that mould."""
        return Balance(self.film.with_mould(design.reshape(-1, 3)), self.volume, self.gas)

    def by_design(self, balance: Balance, points: Values) -> sparse.csc_matrix:
        """The derivatives of its forces by the mould."""
        return balance.skin.forces_by_mould(points)

    def scales(self, design: Values) -> Values:
        """Vertices move by parts of an edge."""
        return np.full(len(design), self._edge)

    def changed(self, design: Values, change: Values) -> Values:
        """The mould with a change, none of whose vertices moves too far."""
        moves = change.reshape(-1, 3)
        far = np.linalg.norm(moves, axis=1, keepdims=True)
        most = FURTHEST * self._edge
        return design + (moves * np.minimum(1.0, most / np.maximum(far, 1e-30))).ravel()

    @cached_property
    def _edge(self) -> float:
        ends, points = mesh_edges(self.mesh).ends, self.mesh.points / self.stretch
        return float(np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1).mean())

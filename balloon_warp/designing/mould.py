"""Balloons of latex: the shape of the mould, which is the rubber's rest shape, and the thickness."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from balloon_warp.designing.gaps import Flattening, Gaps
from balloon_warp.designing.hanging import Hanging
from balloon_warp.designing.measure import Ruler
from balloon_warp.designing.response import Response
from balloon_warp.designing.smooth_step import SmoothAim, Smoothing, smooth_step
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.crossings import find_crossings
from balloon_warp.mesh.topology import mesh_edges
from balloon_warp.mesh.uncrossed import means_over_neighbors, uncrossed
from balloon_warp.statics.balance import Balance
from balloon_warp.statics.film import FilmSkin
from balloon_warp.statics.volume import SealedGas, Volume

Values = NDArray[np.float64]
STRAINS, NEARLY_ALL = 0.25, 99.5
"""Largest change of an edge in a step, over its length, and of how many of the edges it is [%]"""
SHORTENED = 0.5
"""Part of a step that must be left where it is made smaller: else more damping gives a smoother one"""
RAISED, RAISED_MUCH, MUCH = 4.0, 16.0, 0.2
"""Factors on the damping where less of a step is left, and the part of it below which the second counts"""
MOST_DAMPED = 5
"""Largest number of times that a step is made smoother"""
THICKENS = 0.25
"""Largest relative change of a thickness in a step"""
STUCK, MOST_SOLVED = 0.01, 3
"""Part of a change below which a thickness is stuck at a bound; and how often a step is solved without those"""


@dataclass(frozen=True)
class MouldProblem:
    """The places of a mould's vertices."""

    ruler: Ruler
    film: FilmSkin
    """Film with a mould that is the scaled-down target shape"""
    stretch: float
    hanging: Hanging | None = None
    """Gravity, and the vertices that hold the balloon against it"""

    @property
    def topples(self) -> bool:
        """Possibility of unstable equilibria: beyond the largest pressure one part swells at the expense of others."""
        return True

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

    def allowed(self, design: Values) -> bool:
        """Return whether the mould does not cross itself."""
        return not len(find_crossings(design.reshape(-1, 3), self.ruler.triangles).edges)

    def next_design(self, balance: Balance, design: Values, points: Values, damping: float) -> tuple[Values, float]:
        """Return the mould after a step, and its damping, which is raised until the step is smooth."""
        scales = np.full(len(design), self.edge)
        change, damping = self.smooth_change(balance, points, design, scales, damping)
        return self.moved(design, change), damping

    def smooth_change(
        self, balance: Balance, points: Values, design: Values, scales: Values, damping: float,
        by_design: Callable[[Balance, Values], sparse.csc_matrix] | None = None,
    ) -> tuple[Values, float]:  # fmt: skip
        """Return the change of a design that begins with the mould, and its damping.

        Args:
            scales: Magnitudes of easy changes, shape (m,).
            by_design: Function that returns the derivatives of the forces; by the mould if missing.
        """
        response = Response.of(balance, points, (by_design or self.by_design)(balance, points))
        mould = self._mould(design)
        gaps = Gaps.of(mould, self._mould(self.plain), self.film.corners, self.edge)
        aim = SmoothAim(self.mesh.points - points, self.ruler.squares, self._smoothing, scales, gaps, damping)
        change, part = np.zeros(len(design)), 1.0
        for _ in range(MOST_DAMPED):
            change = smooth_step(response, aim)
            part = self._bearable(mould, change)
            if part > SHORTENED:
                break
            aim = replace(aim, damping=aim.damping * (RAISED if part > MUCH else RAISED_MUCH))
        return part * change, aim.damping

    def moved(self, design: Values, change: Values) -> Values:
        """Return the mould with a change, less of it where the mould would cross itself, or its triangles be flat."""
        mould = self._mould(design)
        spoiled = Flattening(mould, self._mould(self.plain), self.film.corners).vertices
        moves = uncrossed(mould.points, self.ruler.triangles, change.reshape(-1, 3), self._means, spoiled)
        return design + moves.ravel()

    def _bearable(self, mould: PolygonMesh, change: Values) -> float:
        """Return the part of a change that strains the mould's edges no more than it may."""
        first, second = mesh_edges(self.mesh).ends.T
        moves, points = change[: mould.points.size].reshape(-1, 3), mould.points
        strains = np.linalg.norm(moves[second] - moves[first], axis=1)
        strains /= np.linalg.norm(points[second] - points[first], axis=1)
        return float(min(1.0, STRAINS / max(np.percentile(strains, NEARLY_ALL), 1.0e-30)))

    def _mould(self, design: Values) -> PolygonMesh:
        return replace(self.mesh, points=design[: self.mesh.points.size].reshape(-1, 3))

    @cached_property
    def _smoothing(self) -> Smoothing:
        return Smoothing(mesh_edges(self.mesh).ends, self.mesh.vertex_count)

    @cached_property
    def _means(self) -> Any:
        """Means over a vertex and its neighbors, shape (n, n)."""
        return means_over_neighbors(self.mesh)

    @cached_property
    def _of_gas(self) -> Values:
        """Return the loads of the gas's weight [N], shape (n, 3)."""
        assert self.hanging is not None
        return self.hanging.weight_of_air(self.gas, self.volume)

    @cached_property
    def edge(self) -> float:
        """Mean edge of the plain mould [m]."""
        ends, points = mesh_edges(self.mesh).ends, self.mesh.points / self.stretch
        return float(np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1).mean())


@dataclass(frozen=True)
class ThicknessProblem:
    """The places of a mould's vertices, and how thick the rubber is there."""

    mould: MouldProblem
    thickest: float
    """Largest thickness over that of the film, which is the least"""

    @property
    def topples(self) -> bool:
        """Possibility of unstable equilibria."""
        return self.mould.topples

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

    def allowed(self, design: Values) -> bool:
        """Return whether the mould does not cross itself."""
        return self.mould.allowed(self.split(design)[0])

    def next_design(self, balance: Balance, design: Values, points: Values, damping: float) -> tuple[Values, float]:
        """Return mould and thickness after a step, and its damping; thickness stays where it is at its bounds."""
        mould, weights = self.split(design)
        stuck, moves, changed = np.zeros(len(weights), dtype=bool), np.zeros(len(mould)), weights
        for _ in range(MOST_SOLVED):
            scales = np.append(np.full(len(mould), self.mould.edge), np.where(stuck, 0.0, THICKENS * weights))
            change, damping = self.mould.smooth_change(balance, points, design, scales, damping, self.by_design)
            moves, thicker = self.split(change)
            changed = self._within(weights, thicker)
            held = (np.abs(changed - weights) < STUCK * np.abs(thicker)) & ~stuck
            if not held.any():
                break
            stuck |= held
        return np.concatenate([self.mould.moved(mould, moves), changed]), damping

    def _within(self, weights: Values, change: Values) -> Values:
        """Return the thickness with a change, within its bounds."""
        low, high = np.maximum(1.0, (1.0 - THICKENS) * weights), np.minimum(self.thickest, (1.0 + THICKENS) * weights)
        return np.clip(weights + change, low, high)

"""Springs of any rest length and constant: their energy, forces, stiffness, and derivatives by rest lengths."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from balloon_warp.statics.blocks import BlockPattern, gathered

Values = NDArray[np.float64]


@dataclass(frozen=True)
class SpringSkin:
    """Hooke's springs between particles."""

    pairs: NDArray[np.int64]
    """Pairs of particles, shape (m, 2)"""
    rest_lengths: Values
    """Rest lengths [m], shape (m,)"""
    constants: Values
    """Spring constants [N/m], shape (m,)"""

    def lengths(self, points: Values) -> Values:
        """Return the lengths [m], shape (m,)."""
        return np.linalg.norm(points[self.pairs[:, 1]] - points[self.pairs[:, 0]], axis=1)

    def energy(self, points: Values) -> float:
        """Return the energy [J]."""
        return float(0.5 * (self.constants * (self.lengths(points) - self.rest_lengths) ** 2).sum())

    def forces(self, points: Values) -> Values:
        """Return the forces on the particles [N], shape (n, 3)."""
        directions, lengths = self._directions(points)
        pulls = (self.constants * (lengths - self.rest_lengths))[:, None] * directions
        return gathered(self._ends, np.concatenate([pulls, -pulls]), len(points))

    def stiffness(self, points: Values) -> sparse.csc_matrix:
        """Return minus the derivatives of the forces by the points [N/m], shape (3 n, 3 n)."""
        directions, lengths = self._directions(points)
        along = self.constants * self.rest_lengths / lengths
        blocks = along[:, None, None] * directions[:, :, None] * directions[:, None, :]
        blocks += (self.constants - along)[:, None, None] * np.eye(3)
        matrix = self._pattern.matrix(np.concatenate([blocks, blocks, -blocks, -blocks]))
        matrix.resize(3 * len(points), 3 * len(points))  # the last particles may have no springs
        return matrix

    def forces_by_lengths(self, points: Values) -> sparse.csc_matrix:
        """Return the derivatives of the forces by the rest lengths [N/m], shape (3 n, m)."""
        directions, _ = self._directions(points)
        values = self.constants[:, None] * directions
        rows = 3 * self.pairs[:, :, None] + np.arange(3)
        columns = np.broadcast_to(np.arange(len(values))[:, None, None], rows.shape)
        signed = np.stack([-values, values], axis=1)
        shape = (3 * len(points), len(values))
        return sparse.csc_matrix((signed.ravel(), (rows.ravel(), columns.ravel())), shape=shape)

    @cached_property
    def _pattern(self) -> BlockPattern:
        """Return the pattern of the stiffness: blocks at both ends of each spring, and between them."""
        a, b, count = *self.pairs.T, int(self.pairs.max()) + 1
        return BlockPattern.of(np.concatenate([a, b, a, b]), np.concatenate([a, b, b, a]), count, count)

    @cached_property
    def _ends(self) -> NDArray[np.int64]:
        return np.concatenate([self.pairs[:, 0], self.pairs[:, 1]])

    def _directions(self, points: Values) -> tuple[Values, Values]:
        """Return unit vectors from the first end to the second, and lengths; coincident ends give a zero vector."""
        away = points[self.pairs[:, 1]] - points[self.pairs[:, 0]]
        lengths = np.maximum(np.linalg.norm(away, axis=1), 1.0e-30)
        return away / lengths[:, None], lengths

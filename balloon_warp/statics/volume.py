"""The volume that a closed mesh encloses, and how it changes with the points."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from balloon_warp.kernels.laws.air import GAS_CONSTANT
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.corners import face_starts
from balloon_warp.mesh.geometry import face_volumes
from balloon_warp.statics.blocks import BlockPattern, cross_matrices, gathered


@dataclass(frozen=True)
class Volume:
    """Volume [m^3] of the mesh as the product has it: a face is a fan of triangles about its center."""

    mesh: PolygonMesh

    def of(self, points: NDArray[np.float64]) -> float:
        """Return the volume with the corners there."""
        return float(face_volumes(replace(self.mesh, points=points)).sum())

    def slopes(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the gradient [m^2], shape (n, 3): times a pressure, the forces."""
        corners, weights = self._triangles
        places = (points - points.mean(axis=0))[corners]
        after, last = np.roll(places, -1, axis=1), np.roll(places, -2, axis=1)
        parts = np.cross(after, last) * (weights / 6.0)[:, None, None]
        return gathered(corners.ravel(), parts.reshape(-1, 3), len(points))

    def curvature(self, points: NDArray[np.float64]) -> sparse.csc_matrix:
        """Return the second derivatives [m], shape (3 n, 3 n)."""
        corners, weights = self._triangles
        places = (points - points.mean(axis=0))[corners]
        blocks = [cross_matrices(places[:, last]) * (weights / 6.0)[:, None, None] for last in (2, 0, 1)]
        return self._pattern.matrix(np.concatenate([part for block in blocks for part in (-block, block)]))

    @cached_property
    def _pattern(self) -> BlockPattern:
        """Return the pattern of the second derivatives: blocks between the corners of each triangle."""
        a, b, c = self._triangles[0].T
        row, column, count = (
            np.concatenate([a, b, b, c, c, a]),
            np.concatenate([b, a, c, b, a, c]),
            len(self.mesh.points),
        )
        return BlockPattern.of(row, column, count, count)

    @cached_property
    def _triangles(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Corners, shape (t, 3), and how much of each counts, shape (t,)."""
        starts, found, weights = face_starts(self.mesh), [], []
        for size in np.unique(self.mesh.face_vertex_counts):
            places, weight = _fans(int(size))
            faces = starts[self.mesh.face_vertex_counts == size]
            found.append(self.mesh.face_vertex_indices[faces[:, None, None] + places].reshape(-1, 3))
            weights.append(np.full(len(faces) * len(places), weight))
        return np.concatenate(found).astype(np.int64), np.concatenate(weights)


def _fans(size: int) -> tuple[NDArray[np.int64], float]:
    """Return the triangles whose mean is a fan about the center, by the corners' places in the face."""
    if size == 3:
        return np.array([[0, 1, 2]]), 1.0
    if size == 4:
        return (np.arange(4)[:, None] + np.arange(3)) % 4, 0.5
    fans = [(j, k, (k + 1) % size) for j in range(size) for k in range(size) if j not in (k, (k + 1) % size)]
    return np.array(fans), 1.0 / size


@dataclass(frozen=True)
class SealedGas:
    """An amount of gas that stays as warm as the air."""

    amount: float
    """Amount of gas [mol]"""
    temperature: float
    """Temperature [K]"""
    air_pressure: float
    """Pressure of the air [Pa]"""

    def pressure(self, volume: float) -> float:
        """Return the gauge pressure [Pa]."""
        return self.amount * GAS_CONSTANT * self.temperature / volume - self.air_pressure

    def stiffness(self, volume: float) -> float:
        """Return the derivative of the pressure by the volume [Pa/m^3]."""
        return self.amount * GAS_CONSTANT * self.temperature / volume**2

    def energy(self, volume: float, before: float) -> float:
        """Return the work to bring the gas from one volume to another [J]."""
        work = self.amount * GAS_CONSTANT * self.temperature * np.log1p((volume - before) / before)
        return float(self.air_pressure * (volume - before) - work)

    @classmethod
    def of(cls, pressure: float, volume: float, temperature: float = 293.15, air_pressure: float = 101325.0) -> Self:
        """Return the gas that presses so much more than the air in this volume."""
        amount = (air_pressure + pressure) * volume / (GAS_CONSTANT * temperature)
        return cls(amount, temperature, air_pressure)

"""Films of a material's law that give way to compression: energy, forces, stiffness, and derivatives by the rest shape.

Everything follows from the law's own function, as kernels call it, on arrays of float64. Its derivatives are complex
steps: exact, without a formula for each law.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from balloon_warp.kernels.laws import Law
from balloon_warp.kernels.laws.tension_field import LEAST_DET
from balloon_warp.model.materials import on_arrays
from balloon_warp.statics.blocks import gathered, of_blocks

Values = NDArray[np.float64]
CORNERS = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
"""Derivatives of a triangle's two edges by its corners"""
TINY = 1.0e-30
"""Step of complex differentiation"""
LEAST_SPREAD = 1.0e-24
"""Least squared difference of squared stretches: at zero, the root has no derivative"""


@dataclass(frozen=True)
class FilmSkin:
    """Triangles of a film, and the shape at which nothing pulls."""

    law: Law
    numbers: Mapping[str, Any]
    """Parameters of the law by name"""
    corners: NDArray[np.int64]
    """Corners, shape (t, 3)"""
    skins: Values
    """Thickness that each triangle stands for [m], shape (t,)"""
    rest_edges: Values
    """Stress-free edges from each triangle's first corner to the others [m], shape (t, 2, 3)"""
    wrinkles: bool = True

    def with_mould(self, mould: Values) -> "FilmSkin":
        """Return the film with another stress-free shape, shape (n, 3)."""
        return replace(self, rest_edges=self._edges(mould))

    def with_weights(self, weights: Values) -> "FilmSkin":
        """Return the same film with its thickness multiplied by weights of the particles, shape (n,)."""
        return replace(self, skins=self.skins * weights[self.corners].mean(axis=1))

    def energy(self, points: Values) -> float:
        """Return the energy [J]."""
        now, rest = metric_of(self._edges(points)), metric_of(self.rest_edges)
        invariants, *_, slack = self._state(now, rest)
        density = _called(self.law.energy, {**self.numbers, **invariants})
        return float((np.where(slack, 0.0, density) * 0.5 * np.sqrt(determinant(rest)) * self.skins).sum())

    def forces(self, points: Values) -> Values:
        """Return the forces on the particles [N], shape (n, 3)."""
        return gathered(self.corners.ravel(), self._pulls(points).reshape(-1, 3), len(points))

    def _pulls(self, points: Values) -> Values:
        """Return the forces of each triangle on its corners [N], shape (t, 3, 3)."""
        edges = self._edges(points)
        tensions = self.tensions(metric_of(edges), metric_of(self.rest_edges))
        pulls = np.einsum("tij,tjx->tix", _square(tensions), edges)
        return np.einsum("ai,tix->tax", -CORNERS, pulls)

    def stiffness(self, points: Values) -> sparse.csc_matrix:
        """Return minus the derivatives of the forces by the points [N/m], shape (3 n, 3 n)."""
        edges, rest = self._edges(points), metric_of(self.rest_edges)
        now = metric_of(edges)
        slopes = _slopes(lambda metric: self.tensions(metric, rest), now)
        blocks = np.einsum("tixc,tcd,tjdy->tijxy", _of_tensions(edges), slopes, _of_metric(edges))
        blocks += _square(self.tensions(now, rest))[..., None, None] * np.eye(3)
        return self._assembled(blocks, len(points))

    def forces_by_mould(self, points: Values) -> sparse.csc_matrix:
        """Return the derivatives of the forces by the shape at rest [N/m], shape (3 n, 3 n)."""
        edges, flat = self._edges(points), self.rest_edges
        now = metric_of(edges)
        slopes = _slopes(lambda metric: self.tensions(now, metric), metric_of(flat))
        blocks = np.einsum("tixc,tcd,tjdy->tijxy", _of_tensions(edges), slopes, _of_metric(flat))
        return -self._assembled(blocks, len(points))

    def forces_by_weights(self, points: Values) -> sparse.csc_matrix:
        """Return the derivatives of the forces by the weights of `with_weights`, at 1 [N], shape (3 n, n)."""
        values = np.repeat(self._pulls(points)[:, :, None] / 3.0, 3, axis=2)  # by triangle, corner pulled, and weighed
        rows = 3 * self.corners[:, :, None, None] + np.arange(3)
        columns = self.corners[:, None, :, None]
        rows, columns = (np.broadcast_to(each, values.shape).ravel() for each in (rows, columns))
        return sparse.csc_matrix((values.ravel(), (rows, columns)), shape=(3 * len(points), len(points)))

    def volumes(self, count: int) -> Values:
        """Return the volume of the material that falls to each particle [m^3], shape (count,)."""
        each = 0.5 * np.sqrt(determinant(metric_of(self.rest_edges))) * self.skins / 3.0
        return np.bincount(self.corners.ravel(), np.repeat(each, 3), count).astype(np.float64)

    def volumes_by_mould(self, count: int) -> sparse.csc_matrix:
        """Return the derivatives of the volumes by the shape at rest [m^2], shape (count, 3 count)."""
        first, second = self.rest_edges[:, 0], self.rest_edges[:, 1]
        normals = np.cross(first, second)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        by_edges = np.stack([np.cross(second, normals), np.cross(normals, first)], axis=1)
        slopes = np.einsum("ai,tix->tax", CORNERS, by_edges) * (self.skins / 6.0)[:, None, None]
        values = np.broadcast_to(slopes[:, None], (len(slopes), 3, 3, 3))  # by triangle, corner, corner moved, and axis
        rows = np.broadcast_to(self.corners[:, :, None, None], values.shape)
        columns = np.broadcast_to(3 * self.corners[:, None, :, None] + np.arange(3), values.shape)
        shape = (count, 3 * count)
        return sparse.csc_matrix((values.ravel(), (rows.ravel(), columns.ravel())), shape=shape)

    def volumes_by_weights(self, count: int) -> sparse.csc_matrix:
        """Return the derivatives of the volumes by the weights of `with_weights`, at 1 [m^3], shape (count, count)."""
        each = 0.5 * np.sqrt(determinant(metric_of(self.rest_edges))) * self.skins / 9.0
        values = np.broadcast_to(each[:, None, None], (len(each), 3, 3))
        rows, columns = np.broadcast_arrays(self.corners[:, :, None], self.corners[:, None, :])
        return sparse.csc_matrix((values.ravel(), (rows.ravel(), columns.ravel())), shape=(count, count))

    def tensions(self, now: Any, rest: Any) -> Any:
        """Return the tensions along the edges, T11, T12 and T22 of each triangle [N/m], shape (t, 3).

        Args:
            now: Dot products of its two edges, 11, 12 and 22 [m^2], shape (t, 3).
            rest: Dot products at rest.
        """
        invariants, major, spread, taut, slack = self._state(now, rest)
        by_trace, by_det = _called(self.law.force, {**self.numbers, **invariants})
        stretched = np.maximum(major, 1.0)
        across = 1.0 / np.sqrt(stretched)
        slope = (by_trace + by_det * across) / np.maximum(spread, 1.0e-12)
        first = np.where(slack, 0.0, np.where(taut, by_trace, slope * stretched))
        second = np.where(slack, 0.0, np.where(taut, by_det, -slope))
        size = determinant(rest)
        volume = np.sqrt(size) * self.skins  # twice that at rest
        inverse = _adjugate(rest) / size[:, None]
        return volume[:, None] * (first[:, None] * inverse + (second / size)[:, None] * _adjugate(now))

    def _state(self, now: Any, rest: Any) -> tuple[dict[str, Any], Any, Any, Any, Any]:
        """Return the invariants of the relaxed state, and of the actual one.

        They are those that the law is evaluated at; the larger squared stretch, and the difference; whether the
        triangle is taut, and whether it is slack.
        """
        size = determinant(rest)
        mixed = (rest[:, 2] * now[:, 0] - 2.0 * rest[:, 1] * now[:, 1] + rest[:, 0] * now[:, 2]) / size
        det = np.maximum(determinant(now) / size, LEAST_DET)
        spread = np.sqrt(np.maximum(mixed * mixed - 4.0 * det, LEAST_SPREAD))
        major = 0.5 * (mixed + spread)
        stretched = np.maximum(major, 1.0)
        stretch = np.sqrt(stretched)
        taut = (det.real >= stretch.real) | (not self.wrinkles)
        across = 1.0 / stretch
        invariants = {
            "trace": np.where(taut, mixed, stretched + across),
            "det": np.where(taut, det, stretch),
            "spread": np.where(taut, spread, stretched - across),
        }
        return invariants, major, spread, taut, (major.real <= 1.0) & self.wrinkles & ~taut

    def _edges(self, points: Values) -> Values:
        """Return the edges from the first corner to the others, shape (t, 2, 3)."""
        places = points[self.corners]
        return places[:, 1:] - places[:, :1]

    def _assembled(self, blocks: Values, count: int) -> sparse.csc_matrix:
        """Assemble the matrix of particles from blocks between edges, of shape (t, 2, 2, 3, 3)."""
        at_corners = np.einsum("ai,tijxy,bj->abtxy", CORNERS, blocks, CORNERS)
        parts = [(self.corners[:, a], self.corners[:, b], at_corners[a, b]) for a in range(3) for b in range(3)]
        return of_blocks(parts, count, count)


def metric_of(edges: Values) -> Values:
    """Return the products of two edges, 11, 12 and 22, shape (t, 3)."""
    first, second = edges[:, 0], edges[:, 1]
    return np.stack([(first * first).sum(1), (first * second).sum(1), (second * second).sum(1)], axis=1)


def determinant(metric: Any) -> Any:
    """Return the squared double area, shape (t,)."""
    return metric[:, 0] * metric[:, 2] - metric[:, 1] ** 2


def _adjugate(metric: Any) -> Any:
    return np.stack([metric[:, 2], -metric[:, 1], metric[:, 0]], axis=1)


def _square(three: Values) -> Values:
    """Return the components 11, 12 and 22 as matrices, shape (t, 2, 2)."""
    return three[:, [[0, 1], [1, 2]]]


def _of_tensions(edges: Values) -> Values:
    """Return the derivatives of an edge's force by the three tensions, shape (t, 2, 3, 3)."""
    first, second, none = edges[:, 0], edges[:, 1], np.zeros_like(edges[:, 0])
    return np.stack([np.stack([first, second, none], axis=2), np.stack([none, first, second], axis=2)], axis=1)


def _of_metric(edges: Values) -> Values:
    """Return the derivatives of the metric by an edge, shape (t, 2, 3, 3)."""
    first, second, none = edges[:, 0], edges[:, 1], np.zeros_like(edges[:, 0])
    by_first = np.stack([2.0 * first, second, none], axis=1)
    return np.stack([by_first, np.stack([none, first, 2.0 * second], axis=1)], axis=1)


def _slopes(of: Callable[[Any], Any], metric: Values) -> Values:
    """Return the derivatives of three numbers of each triangle by three, shape (t, 3, 3), by complex steps."""
    columns = []
    for part in range(3):
        aside = metric.astype(complex)
        scale = np.abs(metric).max(axis=1)
        aside[:, part] += 1j * TINY * scale
        columns.append(of(aside).imag / (TINY * scale)[:, None])
    return np.stack(columns, axis=2)


def _called(function: Any, told: Mapping[str, Any]) -> Any:
    """Call a law with arrays of the arguments that it names."""
    plain = on_arrays(function)
    return plain(**{name: told[name] for name in plain.__code__.co_varnames[: plain.__code__.co_argcount]})

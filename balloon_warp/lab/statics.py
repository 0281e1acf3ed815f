"""Balloons at rest, on the host in float64: energies and stiffness of springs, films and gas, and their equilibrium.

Energies of springs, films and enclosed gas on the host: forces, stiffness, and derivatives by the rest shape.

Films of a material's law that give way to compression: energy, forces, stiffness, and derivatives by the rest shape.

Everything follows from the law's own function, as kernels call it, on arrays of float64. Its derivatives are complex
steps: exact, without a formula for each law.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, Self

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, splu

from balloon_warp.errors import InputError
from balloon_warp.frame import Frame
from balloon_warp.kernels.laws import Law
from balloon_warp.kernels.laws.air import GAS_CONSTANT
from balloon_warp.kernels.laws.membrane import LEAST_DET
from balloon_warp.kernels.laws.springs import KINDS
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import face_starts, face_volumes
from balloon_warp.model.materials import law_of, numbers_of, on_arrays
from balloon_warp.model.model import Model
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Scene

Values = NDArray[np.float64]
Numbers = NDArray[np.integer[Any]]


@dataclass(frozen=True)
class BlockPattern:
    """Sparsity pattern of a matrix of blocks, sorted once for all matrices that are assembled with it."""

    order: Numbers
    """Order of the blocks, by column and row"""
    firsts: Numbers
    """First block of each place, in that order"""
    places: Numbers
    """Index of each block's numbers among those of the matrix"""
    indices: Numbers
    pointers: Numbers
    """Column pointers of the matrix in CSC format"""
    shape: tuple[int, int]

    @classmethod
    def of(cls, row: Numbers, column: Numbers, rows: int, columns: int) -> "BlockPattern":
        """Sort blocks.

        Args:
            row: of each block, shape (n,).
            column: likewise.
            rows: of blocks in the matrix.
            columns: likewise.
        """
        key = np.asarray(column, dtype=np.int64) * rows + row
        order = np.argsort(key, kind="stable")
        places, firsts = np.unique(key[order], return_index=True)
        row, column, three = places % rows, places // rows, np.arange(3)
        counts = np.bincount(column, minlength=columns)
        begins = np.cumsum(counts) - counts
        within = np.arange(len(places)) - begins[column]
        first = 9 * begins[column] + 3 * within
        entries = first[:, None, None] + three[:, None] + 3 * counts[column][:, None, None] * three
        indices = np.empty(9 * len(places), dtype=np.int32)
        indices[entries.ravel()] = np.broadcast_to(3 * row[:, None, None] + three[:, None], entries.shape).ravel()
        pointers = np.append((9 * begins[:, None] + 3 * counts[:, None] * three).ravel(), 9 * len(places))
        return cls(order, firsts, entries.ravel(), indices, pointers.astype(np.int32), (3 * rows, 3 * columns))

    def matrix(self, blocks: Values) -> sparse.csc_matrix:
        """Add blocks up to a matrix, shape (n, 3, 3)."""
        values = np.empty(len(self.places))
        if len(blocks):
            values[self.places] = np.add.reduceat(blocks[self.order], self.firsts, axis=0).ravel()
        return sparse.csc_matrix((values, self.indices, self.pointers), shape=self.shape)


def of_blocks(parts: Sequence[tuple[Numbers, Numbers, Values]], rows: int, columns: int) -> sparse.csc_matrix:
    """Add blocks up to a matrix.

    Args:
        parts: row and column of each block, shape (n,), and the blocks, shape (n, 3, 3).
        rows: of blocks in the matrix.
        columns: likewise.
    """
    row, column = np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
    blocks = np.concatenate([part[2] for part in parts])
    return BlockPattern.of(row, column, rows, columns).matrix(blocks)


def cross_matrices(vectors: Values) -> Values:
    """Return the matrices that multiply by a vector from the left, v x u = [v] u, shape (n, 3, 3)."""
    matrices = np.zeros((len(vectors), 3, 3))
    matrices[:, 0, 1], matrices[:, 0, 2], matrices[:, 1, 2] = -vectors[:, 2], vectors[:, 1], -vectors[:, 0]
    return matrices - matrices.transpose(0, 2, 1)


def gathered(places: Numbers, vectors: Values, count: int) -> Values:
    """Add up vectors of shape (n, 3) by the particles they act on, shape (count, 3)."""
    sums = [np.bincount(places, vectors[:, axis], count) for axis in range(3)]
    return np.stack(sums, axis=1).astype(np.float64)


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


def springs_of(shape: BalloonShape, constants: Values) -> SpringSkin:
    """Return the springs of a balloon.

    Args:
        constants: of the three kinds [N/m].
    """
    springs = shape.springs
    return SpringSkin(
        springs.pairs.astype(np.int64), springs.rest_lengths, constants[springs.kind] * shape.stiffness_scale
    )


def film_of(scene: Scene, number: int, shape: BalloonShape, parameters: Any) -> FilmSkin:
    """Return the membrane of a balloon of rubber or film.

    Args:
        parameters: of one world, by name, each of shape (1, balloon_count, ...).
    """
    law, told = law_of(scene, number), numbers_of(parameters, number)
    assert law is not None
    membrane = shape.membrane
    parts = membrane.areas / (0.5 * np.sqrt(determinant(metric_of(membrane.edges))))  # of the whole thickness
    numbers = {name: values.reshape(3) if values.size == 3 else float(values.item()) for name, values in told.items()}
    skins = numbers["thickness"] * parts
    return FilmSkin(law, numbers, membrane.corners, skins, membrane.edges, wrinkles=numbers["wrinkling"] != 0.0)


class WholeSkin:
    """The springs and the film of a balloon together."""

    def __init__(self, skins: list[Any]):
        self._skins = skins

    def stiffness(self, points: Values) -> Any:
        """Return minus the derivatives of the forces [N/m], shape (3 n, 3 n)."""
        return sum(skin.stiffness(points) for skin in self._skins)


def stiffness_in(model: Model, frame: Frame, world: int, balloon: int) -> LinearOperator:
    """Return `stiffness_operator` of a balloon in a frame.

    Raises:
        InputError: there is no such balloon.
    """
    if not isinstance(balloon, int) or not 0 <= balloon < len(frame.points):
        raise InputError(f"balloon: no balloon {balloon}; expected 0 to {len(frame.points) - 1}")
    points = frame.points[balloon].astype(np.float64)
    return stiffness_operator(model, points, float(frame.pressures[balloon]), world, balloon)


def stiffness_operator(model: Model, points: Values, pressure: float, world: int, number: int) -> LinearOperator:
    """Return the stiffness operator of a balloon [N/m], shape (3 n, 3 n), symmetric.

    It is minus the derivative of the forces of springs, film, pressure and gas by the particles' positions. The gas's
    part is a product of two vectors, so that the matrix is not sparse.

    Args:
        points: Positions of the balloon's particles [m], shape (n, 3).
        pressure: Gauge pressure [Pa].
    """
    shape, scene = model.shapes[number], model.scene
    rows = {name: values.numpy() for name, values in model.parameters.items()}
    own = {name: values[world % len(values)][None] for name, values in rows.items()}
    constants = np.array([own[row.name][0, number] for row in KINDS], dtype=np.float64)
    skins: list[Any] = [springs_of(shape, constants)] if shape.springs.count else []
    if shape.membrane.count:
        skins.append(film_of(scene, number, shape, own))
    volume = Volume(shape.skin)
    matrix = WholeSkin(skins).stiffness(points)
    squeeze = 0.0
    if scene.balloon[number].inflation.kind != "normal_force":
        matrix = matrix - pressure * volume.curvature(points)
    if scene.balloon[number].inflation.kind == "gas":
        gamma = float(own["gamma"][0, number])
        squeeze = gamma * (float(own["air_pressure"][0]) + pressure) / volume.of(points)
    slopes = volume.slopes(points).ravel()

    def times(vector: Values) -> Values:
        return matrix @ vector.ravel() + slopes * (squeeze * (slopes @ vector.ravel()))

    return LinearOperator(matrix.shape, matvec=times, rmatvec=times, dtype=np.float64)  # pyright: ignore

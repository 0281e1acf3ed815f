"""Surroundings of each particle of a balloon: springs, strings, hinges and area, independent of their constants."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.laws.hooke import KINDS
from balloon_warp.mesh.geometry import vertex_areas
from balloon_warp.model.shape import BalloonShape


@dataclass(frozen=True)
class Surroundings:
    """Surroundings of the moving particles of a balloon."""

    mass_share: NDArray[np.float64]
    """Share of the balloon's mass, shape (P,)"""
    area: NDArray[np.float64]
    """Share of the balloon's area [m^2], shape (P,): twice that at the start, since it may grow"""
    spring_counts: NDArray[np.float64]
    """Number of springs by kind, shape (P, 3)"""
    spring_scales: NDArray[np.float64]
    """Sums of spring constants over those of their kinds, shape (P, 3)"""
    strings: NDArray[np.float64]
    """1 where the string holds it, shape (P, count of the balloon's strings)"""
    hinges: NDArray[np.float64]
    """Half the row sums of the stiffness matrix of hinges with a constant of 1 N m/rad [1/m^2], shape (P,)"""
    membrane: NDArray[np.float64]
    """Half the absolute row sums of the membrane's Laplacian, shape (P,)"""
    velocity: NDArray[np.float64]
    """Velocities [m/s], shape (P, 3)"""

    @property
    def particle_count(self) -> int:
        return len(self.mass_share)

    def different(self) -> "Surroundings":
        """Return the distinct ones."""
        parts = [part[:, None] if part.ndim == 1 else part for part in vars(self).values()]
        rows = np.unique(np.concatenate(parts, axis=1), axis=0)
        columns = np.split(rows, np.cumsum([part.shape[1] for part in parts])[:-1], axis=1)
        shapes = [(len(rows), *part.shape[1:]) for part in vars(self).values()]
        return Surroundings(*(part.reshape(shape) for part, shape in zip(columns, shapes, strict=True)))


def surroundings_of(
    shape: BalloonShape, held: Sequence[int], with_hinges: bool, velocities: NDArray[np.float64] | None
) -> Surroundings:
    """Return the surroundings of all moving particles, in their order.

    Args:
        held: Particle that each string of the balloon holds.
        with_hinges: Whether any hinge has a constant; otherwise they are left out, which saves time.
        velocities: Velocities of all particles [m/s]; at rest, when missing.
    """
    count, pairs = shape.mesh.vertex_count, shape.springs.pairs
    counts, scales = np.zeros((count, len(KINDS))), np.zeros((count, len(KINDS)))
    for kind in range(len(KINDS)):
        of_kind = shape.springs.kind == kind
        for end in (0, 1):
            counts[:, kind] += np.bincount(pairs[:, end], of_kind, count)
            scales[:, kind] += np.bincount(pairs[:, end], np.where(of_kind, shape.stiffness_scale, 0.0), count)
    moves = shape.mass_share > 0.0
    return Surroundings(
        mass_share=shape.mass_share[moves],
        area=2.0 * vertex_areas(shape.mesh)[moves],
        spring_counts=counts[moves],
        spring_scales=scales[moves],
        strings=(np.flatnonzero(moves)[:, None] == np.asarray(held, dtype=np.int64)).astype(np.float64),
        hinges=_hinges(shape)[moves] if with_hinges else np.zeros(int(moves.sum())),
        membrane=_membrane(shape)[moves],
        velocity=np.zeros((count, 3))[moves] if velocities is None else velocities[moves],
    )


def _hinges(shape: BalloonShape) -> NDArray[np.float64]:
    """Return a hinge has k g_p g_q for particles p and q in the matrix, where g is the gradient of its angle."""
    hinges = shape.hinges
    sizes = hinges.wing_sizes
    gradients = hinges.gradients(shape.mesh.points)
    rows = 0.5 * gradients * gradients.sum(axis=1, keepdims=True)
    sums = np.zeros(shape.mesh.vertex_count)
    np.add.at(sums, hinges.ends, rows[:, :2])
    np.add.at(sums, hinges.wing_particles, np.repeat((rows[:, 2:] / sizes).ravel(), sizes.ravel()))
    return sums


def _membrane(shape: BalloonShape) -> NDArray[np.float64]:
    """Return row sums, twice which bound the eigenvalues, by Gershgorin's theorem."""
    count = shape.mesh.vertex_count
    pairs, between = shape.membrane.laplacian
    rows, which = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
    total = np.bincount(which.ravel(), between, len(rows))
    sums = np.zeros(count)
    for end in (0, 1):
        sums += np.bincount(rows[:, end], 0.5 * (total + np.abs(total)), count)
    return sums

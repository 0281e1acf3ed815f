"""What is around each particle of a balloon: its springs, strings, hinges and area, whatever their constants are."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.laws.hooke import KINDS
from balloon_warp.mesh.geometry import vertex_areas
from balloon_warp.model.shape import BalloonShape


@dataclass(frozen=True)
class Surroundings:
    """Of the particles of a balloon that move."""

    mass_share: NDArray[np.float64]
    """part of the balloon's mass, shape (P,)"""
    area: NDArray[np.float64]
    """share of the balloon's area [m^2], shape (P,): twice that at the start, for it may grow"""
    spring_counts: NDArray[np.float64]
    """springs by kind, shape (P, 3)"""
    spring_scales: NDArray[np.float64]
    """sums of their constants over that of their kind, shape (P, 3)"""
    strings: NDArray[np.float64]
    """1 where the string holds it, shape (P, count of the balloon's strings)"""
    hinges: NDArray[np.float64]
    """half the row sums of the stiffness matrix of hinges with a constant of 1 N m/rad [1/m^2], shape (P,)"""
    membrane: NDArray[np.float64]
    """half the row sums of the Laplacian of its membrane, without signs, shape (P,)"""
    velocity: NDArray[np.float64]
    """[m/s], shape (P, 3)"""

    @property
    def particle_count(self) -> int:
        return len(self.mass_share)

    def different(self) -> "Surroundings":
        """Those that are different from each other."""
        parts = [part[:, None] if part.ndim == 1 else part for part in vars(self).values()]
        rows = np.unique(np.concatenate(parts, axis=1), axis=0)
        columns = np.split(rows, np.cumsum([part.shape[1] for part in parts])[:-1], axis=1)
        shapes = [(len(rows), *part.shape[1:]) for part in vars(self).values()]
        return Surroundings(*(part.reshape(shape) for part, shape in zip(columns, shapes, strict=True)))


def surroundings_of(
    shape: BalloonShape, held: Sequence[int], with_hinges: bool, velocities: NDArray[np.float64] | None
) -> Surroundings:
    """Of all particles that move, in their order.

    Args:
        held: the particle that each string of the balloon holds.
        with_hinges: whether any has a constant; else they are left out, which saves time.
        velocities: of all particles [m/s]; at rest, when missing.
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
    """A hinge has k g_p g_q for particles p and q in the matrix, where g is the gradient of its angle."""
    hinges = shape.hinges
    sizes = hinges.wing_sizes
    gradients = hinges.gradients(shape.mesh.points)
    rows = 0.5 * gradients * gradients.sum(axis=1, keepdims=True)
    sums = np.zeros(shape.mesh.vertex_count)
    np.add.at(sums, hinges.ends, rows[:, :2])
    np.add.at(sums, hinges.wing_particles, np.repeat((rows[:, 2:] / sizes).ravel(), sizes.ravel()))
    return sums


def _membrane(shape: BalloonShape) -> NDArray[np.float64]:
    """Twice that bounds the eigenvalues, by Gershgorin's theorem."""
    count = shape.mesh.vertex_count
    pairs, between = shape.membrane.laplacian
    rows, which = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
    total = np.bincount(which.ravel(), between, len(rows))
    sums = np.zeros(count)
    for end in (0, 1):
        sums += np.bincount(rows[:, end], 0.5 * (total + np.abs(total)), count)
    return sums

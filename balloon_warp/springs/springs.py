"""The springs of a balloon."""

from collections.abc import Collection
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray


class SpringKind(IntEnum):
    """Deformation that a spring resists (paper, figure 3)."""

    STRUCTURAL = 0
    """Stretch: along an edge of a face"""
    SHEAR = 1
    """Shear: across a face"""
    FLEXION = 2
    """Bending: past one particle between its ends"""


@dataclass(frozen=True)
class Springs:
    """Springs of a mesh, sorted by kind and then by their ends."""

    pairs: NDArray[np.int32]
    """Particles at the ends, the lower first, shape (spring_count, 2)"""
    kind: NDArray[np.int32]
    """Kind, a `SpringKind`, shape (spring_count,)"""
    rest_lengths: NDArray[np.float64]
    """Rest lengths in the unit of the mesh's points, shape (spring_count,)"""

    def of_kinds(self, kinds: Collection[SpringKind]) -> "Springs":
        """Return the springs of some kinds."""
        kept = np.isin(self.kind, [int(kind) for kind in kinds])
        return Springs(self.pairs[kept], self.kind[kept], self.rest_lengths[kept])

    def resting_at(self, points: NDArray[np.float64]) -> "Springs":
        """Return the springs at rest where particles are at these points, shape (particle_count, 3)."""
        lengths = np.linalg.norm(points[self.pairs[:, 1]] - points[self.pairs[:, 0]], axis=1)
        return Springs(self.pairs, self.kind, lengths)

    def with_structural(self, pairs: NDArray[np.integer], points: NDArray[np.float64]) -> "Springs":
        """Return the springs with structural ones between more particles, at rest at their distance.

        Pairs that have springs already keep those.

        Args:
            pairs: Pairs, the lower particle first, each once, shape (n, 2).
            points: Points of the particles, shape (particle_count, 3).
        """
        pairs = pairs[~self.has(pairs)]
        if not len(pairs):
            return self
        all_pairs = np.concatenate([self.pairs, pairs.astype(np.int32)])
        kind = np.concatenate([self.kind, np.full(len(pairs), SpringKind.STRUCTURAL, dtype=np.int32)])
        lengths = np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=1)
        order = np.lexsort((all_pairs[:, 1], all_pairs[:, 0], kind))
        return Springs(all_pairs[order], kind[order], np.concatenate([self.rest_lengths, lengths])[order])

    def has(self, pairs: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Return whether a spring joins each of these pairs of particles, the lower first; shape (n,)."""
        return np.isin(_keys(pairs), _keys(self.pairs))

    @property
    def count(self) -> int:
        return len(self.pairs)

    @property
    def structural_count(self) -> int:
        return int(np.count_nonzero(self.kind == SpringKind.STRUCTURAL))

    @property
    def shear_count(self) -> int:
        return int(np.count_nonzero(self.kind == SpringKind.SHEAR))

    @property
    def flexion_count(self) -> int:
        return int(np.count_nonzero(self.kind == SpringKind.FLEXION))


def _keys(pairs: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return a number for each pair."""
    return (pairs[:, 0].astype(np.int64) << 32) + pairs[:, 1]

"""The springs of a balloon."""

from collections.abc import Collection
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray


class SpringKind(IntEnum):
    """What a spring resists (paper, figure 3)."""

    STRUCTURAL = 0
    """stretch: along an edge of a face"""
    SHEAR = 1
    """shear: across a face"""
    FLEXION = 2
    """bending: over one particle between its ends"""


@dataclass(frozen=True)
class Springs:
    """All springs of a mesh, sorted by kind and then by their ends."""

    pairs: NDArray[np.int32]
    """the particles at the ends, the lower first, shape (spring_count, 2)"""
    kind: NDArray[np.int32]
    """a `SpringKind`, shape (spring_count,)"""
    rest_lengths: NDArray[np.float64]
    """in the unit of the mesh's points, shape (spring_count,)"""

    def of_kinds(self, kinds: Collection[SpringKind]) -> "Springs":
        """Those of some kinds."""
        kept = np.isin(self.kind, [int(kind) for kind in kinds])
        return Springs(self.pairs[kept], self.kind[kept], self.rest_lengths[kept])

    def resting_at(self, points: NDArray[np.float64]) -> "Springs":
        """The same at rest where particles are at these points, shape (particle_count, 3)."""
        lengths = np.linalg.norm(points[self.pairs[:, 1]] - points[self.pairs[:, 0]], axis=1)
        return Springs(self.pairs, self.kind, lengths)

    def with_structural(self, pairs: NDArray[np.integer], points: NDArray[np.float64]) -> "Springs":
        """With springs of the structural kind between more particles, as long as these are apart; of pairs that have
        springs already, those stay.

        Args:
            pairs: the lower first, each once, shape (n, 2).
            points: of the particles, shape (particle_count, 3).
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
        """Whether a spring joins each of these pairs of particles, the lower first; shape (n,)."""
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
    """A number for each pair."""
    return (pairs[:, 0].astype(np.int64) << 32) + pairs[:, 1]

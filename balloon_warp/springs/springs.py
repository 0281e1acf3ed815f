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

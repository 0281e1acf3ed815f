"""Results of a step: arrays in a single block of memory."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np


class Told(NamedTuple):
    """Results of a step, arrays of NumPy or torch with a row a world."""

    observations: Any
    """Shape (world_count, observations), float32"""
    final_observations: Any
    """Observations before worlds have begun anew in the same step"""
    rewards: Any
    """Shape (world_count,), float32"""
    terminated: Any
    """Shape (world_count,), bool"""
    truncated: Any
    causes: Any
    """Why a world has ended other than by its task, int32"""


FLAGS = ("terminated", "truncated")
"""Numbers that become truth values in the results"""
INTEGERS = (*FLAGS, "causes")


@dataclass(frozen=True)
class Layout:
    """Layout of the arrays in a block of 4-byte words."""

    world_count: int
    observations: int
    """Number of observations of a world"""

    @property
    def _shapes(self) -> dict[str, tuple[int, ...]]:
        rows = (self.world_count, self.observations)
        return {name: rows if "observations" in name else rows[:1] for name in Told._fields}

    @property
    def size(self) -> int:
        """Number of words."""
        return sum(int(np.prod(shape)) for shape in self._shapes.values())

    def split(self, block: Any, float32: Any) -> dict[str, Any]:
        """Return the arrays of a block of int32, which share its memory.

        Args:
            block: array of Warp, NumPy or torch.
            float32: data type of that library.
        """
        arrays, begin = {}, 0
        for name, shape in self._shapes.items():
            part = block[begin : (begin := begin + int(np.prod(shape)))]
            arrays[name] = (part if name in INTEGERS else part.view(float32)).reshape(shape)
        return arrays

    def told(self, block: Any, float32: Any) -> Told:
        """Return the results in a block, from the arrays of `split`."""
        arrays = self.split(block, float32)
        return Told(**{name: array != 0 if name in FLAGS else array for name, array in arrays.items()})


def joined(parts: Sequence[Told]) -> Told:
    """Return the results of all worlds, from NumPy's arrays of parts in their order."""
    return Told(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))

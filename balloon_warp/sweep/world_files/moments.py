"""Mean and deviation of numbers that come in pieces, in float64."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from balloon_warp.outputs.world_files.packing import chunk_shape
from balloon_warp.outputs.world_files.world_file import AXES, Field


@dataclass(frozen=True)
class Moments:
    """Count, mean and sum of squared differences from it, of each component (Chan et al. 1983)."""

    count: int
    mean: NDArray[np.float64]
    squares: NDArray[np.float64]

    @classmethod
    def of(cls, field: Field, values: NDArray) -> Self:
        """Return the moments of an array, by pieces: of vectors by component, of other arrays of all numbers."""
        components = field.shape[-1] if field.dimensions[-1] in AXES else 1
        total, rows = cls(0, np.zeros(components), np.zeros(components)), chunk_shape(field)[0]
        for begin in range(0, len(values), rows):
            piece = values[begin : begin + rows].reshape(-1, components).astype(np.float64)
            mean = piece.mean(axis=0)
            total = total.with_more(cls(len(piece), mean, ((piece - mean) ** 2).sum(axis=0)))
        return total

    def with_more(self, other: Self) -> Self:
        """Return the moments of both together."""
        count = self.count + other.count
        if not count:
            return self
        apart, share = other.mean - self.mean, other.count / count
        mean = self.mean + share * apart
        return type(self)(count, mean, self.squares + other.squares + apart**2 * self.count * share)

    def as_json(self) -> dict[str, Any]:
        """Describe the moments for a manifest: numbers of vectors by component, or a number."""
        deviation = np.sqrt(self.squares / max(self.count, 1))
        told = {"mean": self.mean.tolist(), "deviation": deviation.tolist()}
        return {name: numbers if len(numbers) > 1 else numbers[0] for name, numbers in told.items()}

"""A balloon on its way to the wanted shape, for whoever watches."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from balloon_warp.designing.measure import Error, Ruler

Values = NDArray[np.float64]


@dataclass(frozen=True)
class DesignStep:
    """A balloon at rest, as it is after a step of its design."""

    ruler: Ruler
    """of the wanted shape"""
    number: int
    """of steps that were tried"""
    points: Values
    """at rest [m], shape (n, 3)"""
    stretch: float | None
    """in the mean [1]; None where it is not known yet"""
    proven: bool = False
    """whether it is what was simulated from rest, in the end"""

    @property
    def label(self) -> str:
        """What it is, in a few words."""
        return "simulated from rest" if self.proven else f"step {self.number}"

    @cached_property
    def placed(self) -> Values:
        """The points moved and turned onto the wanted shape [m], shape (n, 3)."""
        return self.ruler.aligned(self.points)

    @cached_property
    def error(self) -> Error:
        """How far it is off."""
        return self.ruler.error(self.points)

    @cached_property
    def off(self) -> Values:
        """How far each vertex is off, over the size, shape (n,)."""
        return self.ruler.distances(self.points)[: len(self.points)]

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
    """Ruler of the target shape"""
    number: int
    """Number of steps tried"""
    points: Values
    """Points at rest [m], shape (n, 3)"""
    stretch: float | None
    """Mean stretch [1]; None where it is not known yet"""
    proven: bool = False
    """Whether it is the final simulation from rest"""

    @property
    def label(self) -> str:
        """Label in a few words."""
        return "simulated from rest" if self.proven else f"step {self.number}"

    @cached_property
    def placed(self) -> Values:
        """The points moved and turned onto the wanted shape [m], shape (n, 3)."""
        return self.ruler.aligned(self.points)

    @cached_property
    def error(self) -> Error:
        """Error of the shape."""
        return self.ruler.error(self.points)

    @cached_property
    def off(self) -> Values:
        """Distance of each vertex from the target, over the size, shape (n,)."""
        return self.ruler.distances(self.points)[: len(self.points)]

"""A moment of a simulation that is played with, to come back to."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.scene import Scene
from balloon_warp.viewer.journal import Journal


@dataclass(frozen=True)
class Moment:
    """Moment of a simulation, complete enough to go on from."""

    frame: int
    scene: Scene
    journal: Journal
    numbers: tuple[list[int], list[int]]
    substeps: int
    hands: dict[object, int]
    state: dict[str, NDArray]

    @property
    def extent(self) -> float:
        """Extent of all balloons together [m]."""
        return float(np.ptp(self.state["points"][0], axis=0).max())

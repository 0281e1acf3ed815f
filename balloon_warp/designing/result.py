"""Result of a design, once it was simulated."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.designing.measure import Error
from balloon_warp.scene import Scene
from balloon_warp.shown import Shown, described


@described
@dataclass(frozen=True, repr=False)
class Design(Shown):
    """Designed balloon, and its simulation from rest."""

    scene: Scene
    """Scene that runs as it is"""
    folder: Path
    """Folder with the scene and its files"""
    error: Error
    """Error of the simulation from rest, against the target shape"""
    held_error: Error
    """Error of the designed equilibrium: where it is much smaller than `error`, the balloon comes to rest elsewhere"""
    plain_error: Error | None
    """Error of the baseline: the target shape scaled down by the same stretch, of the same material, inflated as
    much"""
    stretch: float
    """Mean stretch of the design [1]"""
    cannot: list[str]
    """Shortcomings, a sentence each"""
    simulated: NDArray[np.float64]
    """Points at rest [m], shape (n, 3)"""

    def report(self) -> dict[str, Any]:
        """Return the design's figures as JSON."""
        errors = {"error": self.error, "held_error": self.held_error, "plain_error": self.plain_error}
        parts = {
            name: None if each is None else {"mean": each.mean, "worst": each.worst} for name, each in errors.items()
        }
        return {"stretch": self.stretch, **parts, "cannot": self.cannot}

    def __repr__(self) -> str:
        plain = f"; plain shape {self.plain_error}" if self.plain_error else ""
        return f"Design({self.folder}: {self.error} of the size{plain}; stretch {self.stretch:.3g})"

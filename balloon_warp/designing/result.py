"""What a design is, once it was simulated."""

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
    """A balloon that was designed, and what becomes of it from rest."""

    scene: Scene
    """that runs as it is"""
    folder: Path
    """with the scene and its files"""
    error: Error
    """of what was simulated from rest, against the wanted shape"""
    held_error: Error
    """of the balance that was designed: where it is much smaller than `error`, the balloon comes to rest elsewhere"""
    plain_error: Error | None
    """of the rival: the wanted shape made smaller by the same stretch, of the same material, inflated as much"""
    stretch: float
    """of what was designed, in the mean [1]"""
    cannot: list[str]
    """what does not become as it should, a sentence each"""
    simulated: NDArray[np.float64]
    """points at rest [m], shape (n, 3)"""

    def report(self) -> dict[str, Any]:
        """All of it that fits into JSON."""
        errors = {"error": self.error, "held_error": self.held_error, "plain_error": self.plain_error}
        parts = {
            name: None if each is None else {"mean": each.mean, "worst": each.worst} for name, each in errors.items()
        }
        return {"stretch": self.stretch, **parts, "cannot": self.cannot}

    def __repr__(self) -> str:
        plain = f"; plain {self.plain_error}" if self.plain_error else ""
        return f"Design({self.folder}: {self.error} of the size{plain}; stretch {self.stretch:.3g})"

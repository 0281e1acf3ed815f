"""Result of a design, once it was simulated."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.designing.measure import Error
from balloon_warp.scene import Scene
from balloon_warp.shown import Shown, described

SAME = 0.01
"""Relative difference up to which a number that one asked for counts as met"""


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
    stretch_asked: float | None
    """Stretch that was asked for [1]; None of foil"""
    size: float
    """Largest extent of the simulation from rest [m]"""
    size_asked: float
    """Largest extent that was asked for, or of the target's file [m]"""
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
        got = {name: getattr(self, name) for name in ("stretch", "stretch_asked", "size", "size_asked")}
        return {**got, **parts, "cannot": self.cannot}

    @property
    def got(self) -> str:
        """Size and stretch in words, each with the requested value where that differs."""
        size = f"{_got(self.size, self.size_asked, ' m')} large"
        return size + (f", stretch {_got(self.stretch, self.stretch_asked)}" if self.stretch_asked else "")

    def __repr__(self) -> str:
        plain = f"; plain shape {self.plain_error}" if self.plain_error else ""
        return f"Design({self.folder}: {self.error} of the size{plain}; {self.got})"


def _got(got: float, asked: float, unit: str = "") -> str:
    same = abs(got - asked) <= SAME * asked
    return f"{got:.3g}{unit}" if same else f"{got:.4g}{unit} (not {asked:.4g}{unit} as asked)"

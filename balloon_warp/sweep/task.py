"""What a batch is to do, and what came of it, wherever it is simulated."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.scene import Scene
from balloon_warp.sweep.groups import BatchVary, Group


@dataclass(frozen=True)
class BatchTask:
    """Worlds to simulate, and where their files go."""

    scene: Scene
    """what all worlds have in common"""
    groups: list[Group]
    vary: BatchVary
    chosen: NDArray[np.int64]
    """worlds of the stage, ascending"""
    folder: Path
    schedule: str = "auto"
    """as asked for"""

    def settled_schedule(self, on_cpu: bool) -> str:
        """The schedule of all of its worlds. `auto` is settled here for a batch on the CPU, so that a world's result
        does not depend on how many others it is simulated with."""
        many = sum(len(group.worlds) for group in self.groups) > 1
        return "lanes" if self.schedule == "auto" and on_cpu and many else self.schedule


@dataclass(frozen=True)
class Outcome:
    """How a task was done."""

    device: str
    schedule: str
    workers: int
    """processes that simulated"""
    healthy_worlds: int
    seconds: float
    """of simulating and writing"""

"""What a batch is to do, and what came of it, wherever it is simulated."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.beginning import Beginning
from balloon_warp.kernels.laws import Law
from balloon_warp.model import Remark
from balloon_warp.outcomes import BadEnding
from balloon_warp.scene import Scene
from balloon_warp.sweep.blow_ups import Failures
from balloon_warp.sweep.contacts import Pair
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
    on_blowup: str = "freeze"
    """as in `run_batch`"""

    @property
    def laws(self) -> tuple[Law, ...]:
        """Laws that act beside the built-in ones."""
        return self.groups[0].plan.own_laws

    @property
    def world_count(self) -> int:
        return sum(len(group.worlds) for group in self.groups)

    @property
    def particle_count(self) -> int:
        """Number of particles in all worlds together."""
        return sum(len(group.worlds) * group.plan.particle_count for group in self.groups)

    def beginning(self, device: str, schedule: str, workers: int = 1) -> Beginning:
        """Say what is simulated, where, and how."""
        return Beginning(
            worlds=self.world_count,
            particles=self.particle_count,
            frames=self.scene.frames,
            substeps=self.groups[0].plan.substeps,
            frames_per_second=self.scene.frames_per_second,
            device=device,
            schedule=schedule,
            workers=workers,
        )


@dataclass(frozen=True)
class Outcome:
    """How a task was done."""

    device: str
    schedule: str
    workers: int
    """processes that simulated"""
    healthy_worlds: int
    failures: Failures
    bad_endings: list[BadEnding]
    """in worlds of the stage"""
    pairs: list[Pair]
    """of things that pressed each other, which have columns"""
    remarks: list[Remark]
    crowded: int
    """as schedules count it, since this batch began or went on"""
    seconds: float
    """of simulating and writing"""
    resumed: float
    """the part of the work that an earlier batch had done, 0 to 1"""
    removed_stage: bool
    """whether the folder had the stage of an earlier batch, and this batch has none"""

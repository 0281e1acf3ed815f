"""What a run or a batch is once it begins, for those who watch it."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:  # who says what began does so before Warp is there
    from balloon_warp.model import Model


@dataclass(frozen=True)
class Beginning:
    """Say how much there is to simulate, on which device, and by which schedule."""

    worlds: int
    particles: int
    """of all worlds together"""
    frames: int
    substeps: int
    """in one frame; of meshes that differ, of the first"""
    frames_per_second: float
    """that the stage plays"""
    device: str
    schedule: str
    workers: int = 1
    """processes that simulate"""

    @classmethod
    def of(cls, model: "Model", schedule: str) -> Self:
        """Say it of a model, before its first frame."""
        return cls(
            worlds=model.world_count,
            particles=model.world_count * model.particle_count,
            frames=model.scene.frames,
            substeps=model.substeps,
            frames_per_second=model.scene.frames_per_second,
            device=str(model.device),
            schedule=schedule,
        )

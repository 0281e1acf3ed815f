"""Summary of a run or a batch as it begins, for progress displays."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:  # displays import this before Warp is loaded
    from balloon_warp.model import Model


@dataclass(frozen=True)
class Beginning:
    """Say how much there is to simulate, on which device, and by which schedule."""

    worlds: int
    particles: int
    """Number of particles of all worlds together"""
    frames: int
    substeps: int
    """Number of substeps in a frame; where meshes differ, of the first"""
    frames_per_second: float
    """Frame rate of the stage [1/s]"""
    device: str
    schedule: str
    workers: int = 1
    """Number of processes that simulate"""
    many_substeps: str | None = None
    """Sentence on the cause of many substeps of a mesh by itself, and its remedy; None if there are few"""
    strain_bound: str | None = None
    """Sentence on film that is softer than its material, and the substeps that this spares; None without such film"""
    coarse: str | None = None
    """Sentence on a mesh by itself whose faces show, and its remedy; else None"""

    @classmethod
    def of(cls, model: "Model", schedule: str) -> Self:
        """Summarize a model before its first frame."""
        from balloon_warp.model.many_substeps import coarse_said, many_substeps_said
        from balloon_warp.model.strain_bound import strain_bound_said

        return cls(
            worlds=model.world_count,
            particles=model.world_count * model.particle_count,
            frames=model.scene.frames,
            substeps=model.substeps,
            frames_per_second=model.scene.frames_per_second,
            device=str(model.device),
            schedule=schedule,
            many_substeps=many_substeps_said(model.scene, model.shapes, model.substeps),
            strain_bound=strain_bound_said(model),
            coarse=coarse_said(model.scene, model.shapes),
        )

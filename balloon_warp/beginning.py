"""What a run or a batch is once it begins, for those who watch it."""

from dataclasses import dataclass


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

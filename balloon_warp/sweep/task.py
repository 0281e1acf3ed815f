"""Task of a batch and its outcome, wherever it is simulated."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.beginning import Beginning
from balloon_warp.kernels.laws import Law
from balloon_warp.mesh import PolygonMesh
from balloon_warp.model import Remark
from balloon_warp.model.strain_bound import strain_bound_said
from balloon_warp.outcomes import BadEnding
from balloon_warp.provenance import hash_files, hash_of_mesh
from balloon_warp.scene import Scene
from balloon_warp.sweep.blow_ups import Failures
from balloon_warp.sweep.contacts import Pair
from balloon_warp.sweep.groups import SHA256, BatchVary, Group, is_mesh, vary_columns
from balloon_warp.sweep.world_files.options import TrajectoryFiles


@dataclass(frozen=True)
class BatchTask:
    """Worlds to simulate, and where their files go."""

    scene: Scene
    """Scene that all worlds have in common"""
    groups: list[Group]
    vary: BatchVary
    chosen: NDArray[np.int64]
    """Worlds of the stage, ascending"""
    folder: Path
    schedule: str = "auto"
    """Schedule as asked for"""
    on_blowup: str = "freeze"
    """Action after a blow-up, as in `run_batch`"""
    trajectories: TrajectoryFiles | None = None
    """Files of worlds, where they are wanted"""

    table: str = "csv"
    """Kind of the table beside the .npz: "csv" or "parquet\""""

    @property
    def every(self) -> int:
        """Step between frames that go into files of worlds; 0 for none."""
        return self.trajectories.every if self.trajectories else 0

    @property
    def laws(self) -> tuple[Law, ...]:
        """Laws that act beside the built-in ones."""
        return self.groups[0].plan.own_laws

    @cached_property
    def file_hashes(self) -> dict[str, str]:
        """Hashes of the scene's files by place, first asked for before the run: files may change meanwhile."""
        return hash_files(self.scene)

    @cached_property
    def varied(self) -> dict[str, list[Any]]:
        """Values that differ between worlds, one for each: of meshes names, and, with `SHA256`, hashes, as above."""
        columns = {path: column.tolist() for path, column in vary_columns(self.vary).items()}
        for path in filter(is_mesh, self.vary):
            meshes = {id(mesh) if isinstance(mesh, PolygonMesh) else mesh: mesh for mesh in self.vary[path]}
            hashes = {key: hash_of_mesh(mesh) for key, mesh in meshes.items()}
            columns[f"{path}{SHA256}"] = [hashes[id(m) if isinstance(m, PolygonMesh) else m] for m in self.vary[path]]
        return columns

    @property
    def world_count(self) -> int:
        return sum(len(group.worlds) for group in self.groups)

    @property
    def particle_count(self) -> int:
        """Number of particles in all worlds together."""
        return sum(len(group.worlds) * group.plan.particle_count for group in self.groups)

    def beginning(self, device: str, schedule: str, workers: int = 1) -> Beginning:
        """Return the sizes of the simulation, its device, and its schedule."""
        return Beginning(
            worlds=self.world_count,
            particles=self.particle_count,
            frames=self.scene.frames,
            substeps=self.groups[0].plan.substeps,
            frames_per_second=self.scene.frames_per_second,
            device=device,
            schedule=schedule,
            workers=workers,
            strain_bound=strain_bound_said(self.groups[0].plan),
        )


@dataclass(frozen=True)
class Outcome:
    """Outcome of a task."""

    device: str
    schedule: str
    workers: int
    """Number of processes that simulated"""
    healthy_worlds: int
    failures: Failures
    bad_endings: list[BadEnding]
    """Bad endings in worlds of the stage"""
    pairs: list[Pair]
    """Pairs of things in contact that have columns"""
    remarks: list[Remark]
    overflow: int
    """Number of contacts that were ignored, as schedules count them, since this batch began or resumed"""
    seconds: float
    """Duration of simulating and writing [s]"""
    resumed: float
    """Fraction of the work that an earlier batch had done, 0 to 1"""
    removed_stage: bool
    """Whether the folder had the stage of an earlier batch, and this batch has none"""
    hashes: dict[str, str]
    """Hashes of the tables, by the names of their files"""

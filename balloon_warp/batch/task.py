"""Task of a batch and its outcome, wherever it is simulated; worlds that blow up, and checkpoints.

Worlds of a batch that blow up: a report of the first few, an end to all, or a new start in shorter steps.

Detection and explanation of blow-ups are in `balloon_warp/blow_ups.py`; this is the reaction of a batch.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.batch.recorder import SHA256, BatchVary, Group, Pair, Record, Recorder, is_mesh, vary_columns
from balloon_warp.batch.trajectories import TrajectoryFiles
from balloon_warp.blow_ups import MOST_HALVINGS, BlowUp
from balloon_warp.errors import BlowUpError
from balloon_warp.kernels.laws import Law
from balloon_warp.mesh import PolygonMesh
from balloon_warp.model import Remark, lay_out
from balloon_warp.model.strain_bound import strain_bound_sentence
from balloon_warp.run.checkpoints import Checkpoints
from balloon_warp.run.outcomes import BadEnding
from balloon_warp.run.provenance import RunHeader, hash_files, hash_of_mesh, installed_versions
from balloon_warp.scene import Scene
from balloon_warp.simulator import Simulator

MOST_REPORTED = 3
"""Number of worlds of a batch that are replayed to explain their blow-ups"""
RESTARTED = 2
"""Health of a world that blew up and, restarted with shorter steps, did not"""
Rows = NDArray[np.integer]
Replace = Callable[[Rows, Rows, Record], None]
"""Function that replaces the record of some worlds: their rows in the group, the places of those whose shape is
exported among all exported worlds of the group, and one of their frames"""


@dataclass
class Failures:
    """Outcomes of worlds that blew up."""

    reports: list[BlowUp] = field(default_factory=list)
    """Reports of the first few, in their order"""
    restarted: dict[int, int] = field(default_factory=dict)
    """Worlds that are good with shorter steps, and their initial number of substeps a frame"""

    def add(self, others: "Failures") -> None:
        """Add the failures of another part of the batch."""
        self.reports = sorted([*self.reports, *others.reports], key=lambda report: report.world)[:MOST_REPORTED]
        self.restarted = dict(sorted({**self.restarted, **others.restarted}.items()))


def require_health(simulator: Simulator, group: Group, record: Record) -> None:
    """Make sure that all worlds of a group are good.

    Raises:
        BlowUpError: one is not.
    """
    bad = np.flatnonzero(record.healthy == 0)
    if len(bad):
        raise BlowUpError(_report(simulator, group, int(bad[0]), record.number))


def report_failures(simulator: Simulator, group: Group, health: NDArray[np.integer]) -> list[BlowUp]:
    """Explain the blow-ups of the first few bad worlds of a group.

    Args:
        simulator: Simulator of the group.
        health: Health as in `Record`, of all frames, shape (frame_count, world_count).
    """
    bad = np.flatnonzero(health[-1] == 0)[:MOST_REPORTED]
    frames = np.argmax(health[:, bad] == 0, axis=0)
    return [_report(simulator, group, row, frame) for row, frame in zip(bad.tolist(), frames.tolist(), strict=True)]


def _report(simulator: Simulator, group: Group, row: int, frame: int) -> BlowUp:
    return replace(simulator.diagnose(row, frame), world=int(group.worlds[row]))


def restart_failures(
    group: Group, rows: Rows, chosen: Rows, device: wp.Device, schedule: str, put: Replace, every: int = 0
) -> dict[int, int]:
    """Simulate worlds anew with half the step, those that blow up again with half of that, and so on.

    A world that stays bad then has the rows of the last attempt, which stay at its last good frame.

    Args:
        group: of the worlds.
        rows: of the worlds that blew up, by their numbers in the group.
        chosen: the worlds whose shape is wanted, by their numbers in the batch.
        schedule: that simulated the group.
        put: is given every frame of every attempt.
        every: as of a `Recorder`.

    Returns:
        The worlds that are good now, and their substeps.
    """
    places_of_rows = {row: place for place, row in enumerate(group.rows_of(chosen).tolist())}
    good = {}
    for halving in range(1, MOST_HALVINGS + 1):
        if not len(rows):
            break
        part = group.part(rows)
        plan = part.plan.with_times_the_substeps(2**halving)
        simulator = Simulator.of_model(lay_out(plan, device), schedule)
        shown = part.rows_of(chosen)
        places = np.array([places_of_rows[row] for row in rows[shown].tolist()], dtype=np.int64)
        recorder = Recorder(simulator, shown, every)
        healthy = np.ones(len(rows), dtype=np.int32)
        for record in recorder.run():
            put(rows, places, replace(record, healthy=RESTARTED * record.healthy))
            healthy = record.healthy
        good |= dict.fromkeys(part.worlds[healthy != 0].tolist(), plan.substeps)
        rows = rows[healthy == 0]
    return good


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

    def header(self, device: str, schedule: str, workers: int = 1) -> RunHeader:
        """Return the sizes of the simulation, its device, and its schedule."""
        return RunHeader(
            worlds=self.world_count,
            particles=self.particle_count,
            frames=self.scene.frames,
            substeps=self.groups[0].plan.substeps,
            frames_per_second=self.scene.frames_per_second,
            device=device,
            schedule=schedule,
            workers=workers,
            strain_bound=strain_bound_sentence(self.groups[0].plan),
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


PARTIAL_NAME = "partial"


def batch_checkpoints(
    task: BatchTask,
    description: Mapping[str, Any],
    seconds: float,
    resume: bool = False,
    on_note: Callable[[str], None] = lambda sentence: None,
) -> Checkpoints:
    """Return the checkpoints of a batch.

    Args:
        task: the batch.
        description: of it, as of `describe_batch`.
        seconds, resume, on_note: as in `Checkpoints`.
    """
    job = {
        **description,
        "substeps": task.groups[0].plan.substeps,
        "on_blowup": task.on_blowup,
        "trajectories": task.trajectories.as_json() if task.trajectories else None,
        "versions": installed_versions(),
    }
    folder = task.folder / PARTIAL_NAME
    return Checkpoints(folder, "batch", job, task.scene, seconds=seconds, resume=resume, on_note=on_note)


SimulateBatch = Callable[
    [BatchTask, str | None, Checkpoints, Callable[[RunHeader], None], Callable[[int], None]], Outcome
]
"""Function that simulates a batch: its task, device, checkpoints, and listeners to its beginning and frames"""


class BatchPlace(ABC):
    """Workers that simulate a batch in the place of this process, to the same files."""

    @abstractmethod
    def device(self, asked: str | None) -> str | None:
        """Return the device of each worker.

        Raises:
            InputError: a device is asked for that the place chooses itself.
        """

    @abstractmethod
    def started(self) -> AbstractContextManager[SimulateBatch]:
        """Start the workers, which end with the `with` block."""

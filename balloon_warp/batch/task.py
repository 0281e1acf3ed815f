"""Task of a batch and its results, wherever it is simulated: outcomes, tables, the stage and the manifest.

Worlds that blow up get a report of the first few, an end to all, or a new start in shorter steps.

Detection and explanation of blow-ups are in `balloon_warp/blow_ups.py`; here is the reaction of a batch.
"""

import json
import platform
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field, replace
from functools import cached_property
from hashlib import sha256
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.batch.recorder import (
    COLUMNS,
    SHA256,
    BatchVary,
    Group,
    Pair,
    Record,
    Recorder,
    columns_of,
    contacts_shape,
    describe_columns,
    is_mesh,
    pair_columns,
    pressing_pairs,
    vary_columns,
)
from balloon_warp.batch.table import KINDS, WORLDS_NAMES, Columns, TableWriter, table_names, write_worlds
from balloon_warp.batch.trajectories import Contents, TrajectoryFiles, TrajectoryWriter
from balloon_warp.blow_ups import MOST_HALVINGS, BlowUp
from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.kernels.laws import Law
from balloon_warp.mesh import PolygonMesh
from balloon_warp.model import Remark, lay_out
from balloon_warp.model.stability import strain_bound_described, strain_bound_sentence
from balloon_warp.run.checkpoints import JOB_NAME, CheckpointOptions, Checkpoints, Part
from balloon_warp.run.report import (
    BadEnding,
    LastFrame,
    RunHeader,
    bad_endings,
    describe_laws,
    describe_scene,
    hash_files,
    hash_of_file,
    hash_of_mesh,
    installed_versions,
    without_folders,
)
from balloon_warp.scene import Scene
from balloon_warp.scene.load import files_of_scene
from balloon_warp.simulator import Simulator
from balloon_warp.system.files import (
    check_writable,
    manifest_text,
    require_no_inputs,
    require_ours_in,
    sole_writer,
    target_of,
    whole_file,
)

if TYPE_CHECKING:
    from balloon_warp.usd.grid import GridGroup


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
        seconds, resume, on_note: as in `CheckpointOptions`.
    """
    job = {
        **description,
        "substeps": task.groups[0].plan.substeps,
        "on_blowup": task.on_blowup,
        "trajectories": task.trajectories.as_json() if task.trajectories else None,
        "versions": installed_versions(),
    }
    folder = task.folder / PARTIAL_NAME
    return Checkpoints(folder, "batch", job, task.scene, CheckpointOptions(seconds, resume, on_note))


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


MANIFEST_NAME = "manifest.json"
MANIFEST_NAMES = (MANIFEST_NAME, f"{PARTIAL_NAME}/{JOB_NAME}")
"""Files of which one of ours tells that a folder is a batch's"""


def describe_batch(task: BatchTask) -> dict[str, Any]:
    """Describe the inputs of a batch, as JSON has them, the same wherever its files are.

    Before the run: files may change meanwhile. A mesh from Python has the hash of its arrays, and its name.
    """
    described = {
        "scene": describe_scene(task.scene),
        "worlds": task.world_count,
        "vary": task.varied,
        "export": task.chosen.tolist(),
        "laws": describe_laws(task.laws),
        "files": task.file_hashes,
        "strain_bound": strain_bound_described(task.groups[0].plan),
    }
    return without_folders(described)


def write_manifest(
    task: BatchTask,
    description: Mapping[str, Any],
    provenance: Mapping[str, Any],
    outcome: Outcome,
    names: Sequence[str],
) -> Path:
    """Write the manifest, after the outputs that it names: one that does not fit them is an earlier batch's.

    Args:
        task: of the batch.
        description: of it, as of `describe_batch`.
        provenance: where its values came from, such as the command and the seed.
        outcome: how it was done.
        names: of the files in the folder.

    Raises:
        InputError: it cannot be written.
    """
    hashes = [outcome.hashes.get(name) or hash_of_file(task.folder / name) for name in names]
    manifest = {
        **provenance,
        "versions": installed_versions(),
        "platform": platform.platform(),
        "device": outcome.device,
        "schedule": outcome.schedule,
        "schedule_asked": task.schedule,
        "workers": outcome.workers,
        "on_blowup": task.on_blowup,
        "healthy_worlds": outcome.healthy_worlds,
        "restarted_worlds": {str(world): substeps for world, substeps in outcome.failures.restarted.items()},
        "table": task.table,
        "trajectories": task.trajectories.as_json() if task.trajectories else None,
        "blow_ups": [report.as_json() for report in outcome.failures.reports],
        **description,
        "columns": describe_columns(task.scene, task.varied, task.laws, outcome.pairs),
        "outputs": dict(zip(names, hashes, strict=True)),
    }
    path = task.folder / MANIFEST_NAME
    with whole_file(path) as temporary:
        temporary.write_text(manifest_text(manifest), encoding="utf-8")
    return path


STAGE_NAME = "worlds.usdc"
MOST_LOOKED_AT = 16
"""Number of worlds of the stage whose endings are examined: one takes some hundredths of a second"""


class BatchOutput:
    """Writes frames of a batch; its files appear when the `with` block, in which nobody else writes them, ends well.

    Args:
        task: of the batch. Its folder gets the tables and `worlds.usdc`; where no worlds are chosen there is no
            stage, and an earlier batch's goes.
        groups: the worlds, as they come together.

    Raises:
        InputError: a folder cannot be written to, or has files of somebody else where ours go.
    """

    def __init__(self, task: BatchTask, groups: Sequence[Group]):
        folder, scene, chosen, vary = task.folder, task.scene, task.chosen, task.vary
        _prepare_folder(task)
        self.groups = groups
        worlds = sum(len(group.worlds) for group in groups)
        varied = vary_columns(vary)
        self._hashes = {path: np.array(column) for path, column in task.varied.items() if path.endswith(SHA256)}
        columns, rate = Columns(varied, columns_of(scene)), scene.frames_per_second
        self.table = TableWriter(folder, scene.frames + 1, rate, columns, worlds, task.table)
        self._plan = groups[0].plan
        self.contacts = np.zeros((worlds, *contacts_shape(self._plan), len(COLUMNS)), dtype=np.float32)
        """Contact measures of each pair, as in `Recorder`, of all worlds"""
        self._endings: dict[int, str] = {}
        self._has_worlds = False
        self.stage_path = folder / STAGE_NAME
        self.removed_stage = False
        """Whether the stage of an earlier batch was there and this one has none"""
        self.stage = None
        if len(chosen):
            from balloon_warp.usd.grid import GridWriter  # loads USD: only for a stage

            self.stage = GridWriter(self.stage_path, [_in_grid(group, chosen, varied) for group in groups])
        self.trajectories = _trajectories(task, groups)

    @property
    def healthy_count(self) -> int:
        """Worlds that are good at the end."""
        return int(np.count_nonzero(self.table.health[-1]))

    def __enter__(self) -> Self:
        with ExitStack() as files:
            files.enter_context(sole_writer(self.table.folder, self.trajectories and self.trajectories.folder))
            npz, text = (files.enter_context(whole_file(self.table.folder / name)) for name in WORLDS_NAMES)
            files.enter_context(self.table)
            if self.stage:
                files.enter_context(self.stage)
            self._worlds = npz, text
            files.push(self._end_worlds)  # the first to be written, the last to be in their places
            files.push(self._end_trajectories)
            self._files = files.pop_all()
        return self

    def write(self, records: list[Record]) -> None:
        """Write the next frame: a record of each group."""
        for number, record in enumerate(records):
            self.add(number, record)
        self.end_frame()

    def add(self, group: int, record: Record) -> None:
        """Add a frame of one group."""
        self._put(self.groups[group].worlds, record)
        if self.stage:
            self.stage.write(record.number, group, record.shapes)
        if self.trajectories:
            self.trajectories.add(group, record)

    def replace(self, group: int, rows: NDArray[np.integer], places: NDArray[np.integer], record: Record) -> None:
        """Replace the record of some worlds of a group in its frame.

        The table's text changes once `rewrite_table` is called.

        Args:
            rows: Numbers of the worlds in the group.
            places: Places of those of them that are exported, among the group's exported worlds.
        """
        self._put(self.groups[group].worlds[rows], record)
        if self.stage:
            self.stage.write(record.number, group, record.shapes, places=places.tolist())
        if self.trajectories:
            self.trajectories.replace(group, rows, record)

    def _put(self, worlds: NDArray[np.integer], record: Record) -> None:
        self.table.values[record.number][:, worlds] = record.measures.T
        self.table.health[record.number, worlds] = record.healthy
        if record.contacts is not None:
            self.contacts[worlds] = record.contacts

    def begin_trajectories(self, resumed: bool) -> None:
        """Create the files of worlds, where they are wanted, or go on with those of an earlier batch."""
        if self.trajectories:
            self.trajectories.begin(resumed)

    def _end_trajectories(self, kind: type[BaseException] | None, *_: object) -> None:
        if self.trajectories and kind is None:
            self.trajectories.finish(self.table.health[-1])
        elif self.trajectories:
            self.trajectories.give_up()

    @property
    def pairs(self) -> list[Pair]:
        """Pairs of things that pressed each other in any world."""
        return pressing_pairs(self._plan, self.contacts)

    def rows(self, part: Part) -> dict[str, NDArray]:
        """Return a part of the table, once the files of worlds are as far: arrays by name.

        They are the `worlds` of the part's groups, the names of the measures, `columns`, and of each frame and
        world its `values` and `health`; of each world its `contacts`.

        Raises:
            InputError: a file of a world cannot be written.
        """
        if self.trajectories:
            self.trajectories.save()
        worlds = np.concatenate([self.groups[group].worlds for group in part.groups])
        frames = slice(part.frames.start, part.frames.stop)
        return {
            "worlds": worlds,
            "columns": np.array(self.table.columns.measures),
            "values": self.table.values[frames][:, :, worlds].swapaxes(1, 2),
            "health": self.table.health[frames, worlds],
            "contacts": self.contacts[worlds],
        }

    def take_rows(self, part: Part, saved: Mapping[str, NDArray]) -> None:
        """Put a part of the table in its place, as `rows` gave it."""
        frames, worlds = slice(part.frames.start, part.frames.stop), saved["worlds"]
        self.table.values[frames][:, :, worlds] = saved["values"].swapaxes(1, 2)
        self.table.health[frames, worlds] = saved["health"]
        self.contacts[worlds] = saved["contacts"]

    def rewrite_table(self) -> None:
        """Write the replaced rows of the table."""
        self.table.write_again()

    def endings(self) -> list[BadEnding]:
        """Find the bad endings in worlds of the stage, in at most `MOST_LOOKED_AT` of them, spread evenly."""
        if not self.stage:
            return []
        exported = [
            (int(world), group, place)
            for group, part in enumerate(self.stage.groups)
            for place, world in enumerate(part.worlds)
            if self.table.health[-1, world]
        ]
        found = []
        for world, group, place in sorted(exported)[:: -(-len(exported) // MOST_LOOKED_AT) or 1]:
            plan = self.groups[group].plan
            before, points = self.stage.last_points(group, place)
            rate = plan.scene.frames_per_second
            velocities = [rate * (end - begin) for begin, end in zip(before, points, strict=True)]
            poses, torn = self.stage.last_obstacle_poses(group, place), self.stage.last_torn(group, place)
            for ending in bad_endings(plan, LastFrame(plan.scene.frames, points, velocities, poses, torn)):
                self._endings.setdefault(world, ending.kind)
                found.append(replace(ending, sentence=f"world {world}: {ending.sentence}"))
        return found

    def finish(self, frames: int = 0) -> dict[str, str]:
        """Write the tables to their ends, side by side: all measures are there, and all endings found.

        Args:
            frames: number of frames whose rows are to be written.

        Returns:
            The hashes of the files, by their names.
        """

        def rows() -> list[Path]:
            for _ in range(frames):
                self.end_frame()
            return [self.table.end_rows()]

        npz, text = table_names(self.table.kind)
        jobs = {(text,): rows, (npz,): lambda: [self.table.write_arrays()], WORLDS_NAMES: self._write_worlds}
        with ThreadPoolExecutor(len(jobs), thread_name_prefix="writer") as threads:
            hashed = [threads.submit(lambda job=job: [hash_of_file(path) for path in job()]) for job in jobs.values()]
            hashes = [of_job.result() for of_job in hashed]
        return dict(zip(chain(*jobs), chain(*hashes), strict=True))

    def _write_worlds(self) -> tuple[Path, Path]:
        """Write the summary of all worlds, unless it is written; return its files."""
        if not self._has_worlds:
            further = self._hashes | dict(pair_columns(self.pairs, self.contacts))
            write_worlds(*self._worlds, self.table, self._endings, further)
        self._has_worlds = True
        return self._worlds

    def _end_worlds(self, kind: type[BaseException] | None, *_: object) -> None:
        """Write the summary, unless the run failed."""
        if kind is None:
            self._write_worlds()

    def health_of(self, group: int) -> NDArray[np.int32]:
        """Return the health of a group's worlds in all frames, shape (frame_count, world_count)."""
        return self.table.health[:, self.groups[group].worlds]

    def end_frame(self) -> None:
        """Start the next frame, once all groups of this one are there."""
        self.table.write_frame()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._files.__exit__(kind, error, traceback)
        if kind is None and not self.stage and self.stage_path.exists():
            target_of(self.stage_path).unlink()
            self.removed_stage = True


def _trajectories(task: BatchTask, groups: Sequence[Group]) -> TrajectoryWriter | None:
    """Return the writer of files of worlds, where they are wanted."""
    if task.trajectories is None:
        return None
    contents = Contents(task.scene, task.vary, task.laws, task.every, task.varied, task.file_hashes)
    described = json.dumps([*describe_batch(task).values(), task.on_blowup])
    return TrajectoryWriter(task.trajectories, contents, groups, {"batch": sha256(described.encode()).hexdigest()})


def _in_grid(group: Group, chosen: NDArray[np.integer], varied: Mapping[str, NDArray]) -> "GridGroup":
    from balloon_warp.usd.grid import GridGroup

    worlds = group.those_of(chosen)
    values = {path: column[worlds] for path, column in varied.items()}
    return GridGroup(group.plan, group.rows_of(chosen), worlds, values)


def _prepare_folder(task: BatchTask) -> None:
    folder = task.folder
    try:
        target_of(folder).mkdir(exist_ok=True)
    except FileNotFoundError:
        raise InputError(f"{folder}: the folder {folder.parent} does not exist") from None
    except (FileExistsError, NotADirectoryError):
        raise InputError(f"{folder}: is a file; expected a folder") from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}") from None
    names = {*chain(*map(table_names, KINDS)), *WORLDS_NAMES, STAGE_NAME, MANIFEST_NAME}  # tables of other kinds go
    require_ours_in(folder, sorted(names), MANIFEST_NAMES)
    for group in task.groups:
        require_no_inputs((folder / name for name in names), files_of_scene(group.plan.scene))
    for name in (*table_names(task.table), *WORLDS_NAMES, STAGE_NAME, MANIFEST_NAME):
        check_writable(folder / name, (Path(name).suffix,))

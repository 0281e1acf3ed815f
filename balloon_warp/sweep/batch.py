"""A batch: many worlds of a scene that differ, simulated together; a table of all, and a stage of the chosen ones."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.arguments import checked
from balloon_warp.beginning import Beginning
from balloon_warp.blow_ups import check_policy
from balloon_warp.errors import InputError
from balloon_warp.files import is_same_file
from balloon_warp.kernels.laws import Law
from balloon_warp.model import remark_sentences
from balloon_warp.model.varied_scene import scene_to_vary
from balloon_warp.outcomes import BadEnding, ending_sentences
from balloon_warp.outputs.table import settled_table, table_names
from balloon_warp.outputs.worlds_table import WORLDS_NAMES
from balloon_warp.resume import CHECKPOINT_SECONDS, Checkpoints
from balloon_warp.scene import Scene, SceneLike
from balloon_warp.schedules.contact_lists import overflow_remarks
from balloon_warp.shown import Shown, described
from balloon_warp.sweep.checkpoints import batch_checkpoints
from balloon_warp.sweep.cluster import Cluster
from balloon_warp.sweep.distribute import distribute_batch
from balloon_warp.sweep.groups import BatchVary, plan_groups
from balloon_warp.sweep.local import simulate_locally
from balloon_warp.sweep.manifest import MANIFEST_NAME, describe_batch, write_manifest
from balloon_warp.sweep.memory import require_room
from balloon_warp.sweep.output import STAGE_NAME
from balloon_warp.sweep.remote import connect
from balloon_warp.sweep.task import BatchTask, Outcome
from balloon_warp.sweep.workers import Workers
from balloon_warp.sweep.world_files.options import TrajectoryFiles, TrajectoryFilesLike
from balloon_warp.sweep.world_files.writer import remove_partial

SHARES = "balloon_warp.sweep.shares"
"""Module that simulates shares"""


@described
@dataclass(frozen=True)
class BatchSummary(Shown):
    """Summary of a batch: its output, amounts and speed."""

    output: str
    """Output folder"""
    table: list[str]
    """Files with a row for each world and frame"""
    worlds_table: list[str]
    """Files with a row for each world"""
    stage: str | None
    """Stage of the exported worlds"""
    trajectories: str | None
    """Folder of the files of worlds"""
    manifest: str
    """Manifest: hashes of the files, and all that reproduction takes"""
    removed_stage: str | None
    """Stage of an earlier batch in the same folder, removed because this one exports no worlds"""
    scene: str
    device: str
    schedule: str
    workers: int
    """Number of processes that simulated: 1 without a cluster"""
    worlds: int
    exported_worlds: int
    unhealthy_worlds: int
    """Number of worlds that blew up; their rows stay at the last good frame"""
    restarted_worlds: int
    """Number of worlds that blew up, and did not with shorter steps"""
    blow_ups: list[str]
    """Reasons why the first few worlds blew up"""
    bad_endings: list[BadEnding]
    """Balloons that came apart, fell forever, collapsed or folded over by the last frame, in exported worlds; of many a
    few are examined, spread evenly"""
    particles: int
    """Number of particles in all worlds"""
    springs: int
    """Number of springs in all worlds"""
    frames: int
    frames_per_second: float
    """Frame rate of the stage [1/s]"""
    substeps: int
    """Number of substeps in a frame"""
    resumed: float
    """Fraction of the work that an earlier batch had done, from 0, without `resume`, to 1"""
    wall_seconds: float
    """Duration of simulating and writing, once there are workers [s]"""
    particle_substeps_per_second: float

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


@checked
def run_batch(
    scene: SceneLike,
    folder: str | Path,
    world_count: int,
    vary: BatchVary | None = None,
    *,
    export: Sequence[int] = (),
    name: str = "",
    device: str | None = None,
    schedule: str = "auto",
    on_blowup: str = "freeze",
    cluster: Cluster | None = None,
    trajectories: TrajectoryFilesLike | None = None,
    table: str = "auto",
    laws: Sequence[Law] = (),
    provenance: Mapping[str, Any] | None = None,
    checkpoint_seconds: float = CHECKPOINT_SECONDS,
    resume: bool = False,
    on_begin: Callable[[Beginning], None] = lambda beginning: None,
    on_frame: Callable[[int], None] = lambda number: None,
    on_note: Callable[[str], None] = lambda sentence: None,
    on_warning: Callable[[str], None] = lambda sentence: None,
) -> BatchSummary:
    """Simulate worlds that differ, and write tables of them and a stage of the chosen ones.

    `table` has a row for each world and frame, `worlds` for each world, `worlds.usdc` is the stage. `repeat_batch`
    makes all again, from `manifest.json`. Checkpoints, also on Ctrl-C, go into the folder `partial`.

    Args:
        scene: Scene of all worlds, or a source that `load_scene` takes.
        folder: Output folder; created if it does not exist.
        world_count: Number of worlds.
        vary: Values that differ: dotted paths as in overrides, and a value for each world, shape (world_count,).
        export: Worlds that are written into the stage.
        name: Name of the scene in the summary.
        device: Warp device; the GPU, or else the CPU, if not given.
        schedule: Parallel schedule: "scatter", "gather", "block", "lanes", "octets", or "auto" for the fastest.
        on_blowup: "freeze" keeps the rows of a world that blows up at its last good frame; "restart" simulates it anew
            after the others with half the step, `MOST_HALVINGS` times at most; "stop" ends all.
        cluster: Workers that simulate the batch; this process if not given. The files are the same.
        trajectories: Folder for a file of each world with its trajectories, or `TrajectoryFiles` with its options.
        table: "csv", "parquet", or "auto" for CSV of few rows, and Parquet of others where pyarrow is installed.
        laws: User-defined laws beside the built-in ones; on a cluster, global names that workers can import.
        provenance: Further provenance for the manifest, such as a command and a seed.
        checkpoint_seconds: Interval between checkpoints; 0 for one only when the batch is stopped.
        resume: Go on from the last checkpoint, if there is one, to the same files as a batch that was never stopped.
        on_begin: Called once, before all others, with a summary of the batch.
        on_frame: Called with the number of each simulated frame; on a cluster now and then, on average.
        on_note: Called with sentences: where the batch begins, and an earlier one that was not finished.
        on_warning: Called with sentences: defects of meshes and their treatment, ends of exported worlds, omissions.

    Raises:
        InputError: the scene cannot be simulated, a value or a law is wrong, the worlds do not fit, a folder cannot be
            written, the cluster is not there, or a checkpoint is another batch's; earlier files stay.
        BlowUpError: a world blew up, which is to stop all; earlier files stay.
        MissingExtraError: a scheduler is given and dask.distributed is not installed.
        WorkersLostError: the cluster's workers or its scheduler end; earlier files stay.
        KeyboardInterrupt: Ctrl-C, after the frame and the checkpoint; the message says how to go on.
    """
    check_policy(on_blowup)
    scene = scene_to_vary(scene, vary)
    vary, chosen = vary or {}, _chosen(scene, export, world_count)
    device = cluster.device(device) if cluster else device
    require_room(scene, world_count, vary, device, schedule, laws, spread=cluster is not None)
    with connect(cluster, SHARES) if cluster else nullcontext() as workers:  # which start while this plans
        files, kind = _files(trajectories, folder), settled_table(table, world_count * (scene.frames + 1))
        groups = plan_groups(scene, world_count, vary, laws)
        task = BatchTask(scene, groups, vary, chosen, Path(folder), schedule, on_blowup, files, kind)
        checkpoints = batch_checkpoints(task, description := describe_batch(task), checkpoint_seconds, resume, on_note)
        try:
            begin = _warning(task, on_begin, on_warning)
            outcome = _simulate(task, (cluster, workers), device, checkpoints, begin, on_frame)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(checkpoints.advice) from None
    write_manifest(task, description, {"name": name, **(provenance or {})}, outcome, _names(task))
    checkpoints.remove()
    remove_partial(task.trajectories)
    for sentence in _remarks(outcome):
        on_warning(sentence)
    return _summary(task, outcome, name)


def _names(task: BatchTask) -> list[str]:
    """Return the names of the files in the folder, but for the manifest's."""
    return [*table_names(task.table), *WORLDS_NAMES, *([STAGE_NAME] if len(task.chosen) else [])]


def _files(trajectories: TrajectoryFiles | str | Path | None, folder: str | Path) -> TrajectoryFiles | None:
    """Return where trajectories go.

    Raises:
        InputError: it is where the tables are.
    """
    files = TrajectoryFiles.of(trajectories)
    if files and is_same_file(Path(files.folder), Path(folder)):
        raise InputError(f"trajectories {files.folder}: is the batch's own folder; expected another, or a folder in it")
    return files


def _warning(
    task: BatchTask, on_begin: Callable[[Beginning], None], on_warning: Callable[[str], None]
) -> Callable[[Beginning], None]:
    """Make a listener to the beginning that passes on the warnings about meshes, too."""

    def begin(beginning: Beginning) -> None:
        on_begin(beginning)
        for warning in dict.fromkeys(sentence for group in task.groups for sentence in group.plan.warnings):
            on_warning(warning)

    return begin


def _chosen(scene: Scene, export: Sequence[int], world_count: int) -> NDArray[np.int64]:
    """Choose the worlds to export, ascending.

    Raises:
        InputError: one is not there.
    """
    chosen = np.unique(np.asarray(export, dtype=np.int64))
    if len(chosen) and not 0 <= chosen[0] <= chosen[-1] < world_count:
        raise InputError(f"export: expected worlds 0 to {world_count - 1} (got {chosen[0]} to {chosen[-1]})")
    return chosen


def _simulate(
    task: BatchTask,
    where: tuple[Cluster | None, Workers | None],
    device: str | None,
    checkpoints: Checkpoints,
    on_begin: Callable[[Beginning], None],
    on_frame: Callable[[int], None],
) -> Outcome:
    """Simulate on the cluster's workers, or here."""
    cluster, workers = where
    if not cluster or not workers:
        return simulate_locally(task, device, checkpoints, on_begin, on_frame)
    return distribute_batch(task, cluster, workers, device, checkpoints, on_begin, on_frame)


def _remarks(outcome: Outcome) -> list[str]:
    """Return the remarks at the end of a batch."""
    ends, worlds = ending_sentences(outcome.bad_endings), remark_sentences(outcome.remarks)
    return [*ends, *worlds, *overflow_remarks(outcome.overflow)]


def _summary(task: BatchTask, outcome: Outcome, name: str) -> BatchSummary:
    """Make the summary that `run_batch` returns."""
    scene, groups, stage = task.scene, task.groups, str(task.folder / STAGE_NAME)
    substeps = groups[0].plan.substeps
    particles = task.particle_count
    simulated = particles * substeps * scene.frames * (1.0 - outcome.resumed)
    return BatchSummary(
        output=str(task.folder),
        table=[str(task.folder / table) for table in table_names(task.table)],
        worlds_table=[str(task.folder / table) for table in WORLDS_NAMES],
        stage=stage if len(task.chosen) else None,
        trajectories=str(task.trajectories.folder) if task.trajectories else None,
        manifest=str(task.folder / MANIFEST_NAME),
        removed_stage=stage if outcome.removed_stage else None,
        scene=name,
        device=outcome.device,
        schedule=outcome.schedule,
        workers=outcome.workers,
        worlds=task.world_count,
        exported_worlds=len(task.chosen),
        unhealthy_worlds=task.world_count - outcome.healthy_worlds,
        restarted_worlds=len(outcome.failures.restarted),
        bad_endings=outcome.bad_endings,
        blow_ups=[str(report) for report in outcome.failures.reports],
        particles=particles,
        springs=sum(len(group.worlds) * group.plan.spring_count for group in groups),
        frames=scene.frames,
        frames_per_second=scene.frames_per_second,
        substeps=substeps,
        resumed=round(outcome.resumed, 3),
        wall_seconds=round(outcome.seconds, 3),
        particle_substeps_per_second=round(simulated / outcome.seconds),
    )

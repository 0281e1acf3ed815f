"""A batch: many worlds of a scene that differ, simulated together in this process, and again from its manifest."""

import json
import math
import time
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.batch.recorder import (
    SHA256,
    BatchVary,
    Group,
    Record,
    Recorder,
    bytes_of_frame,
    columns_of,
    contact_bytes,
    is_mesh,
    picked_bytes,
    plan_groups,
    record_bytes,
)
from balloon_warp.batch.table import WORLDS_NAMES, resolved_table, table_names
from balloon_warp.batch.task import (
    MANIFEST_NAME,
    STAGE_NAME,
    BatchOutput,
    BatchPlace,
    BatchTask,
    Failures,
    Outcome,
    batch_checkpoints,
    describe_batch,
    report_failures,
    require_health,
    restart_failures,
    write_manifest,
)
from balloon_warp.batch.trajectories import TrajectoryFiles, TrajectoryFilesLike, remove_partial
from balloon_warp.blow_ups import check_policy
from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Law
from balloon_warp.model import Model, lay_out, plan_model, remark_sentences, remarks_on, world_bytes
from balloon_warp.model.parameters import SHAPING, scene_to_vary
from balloon_warp.model.shape import shape_balloon
from balloon_warp.model.state import require_memory
from balloon_warp.run.checkpoints import CHECKPOINT_SECONDS, WAITING, Checkpoints, record_frames
from balloon_warp.run.report import BadEnding, RunHeader, describe_laws, ending_sentences, hash_of_file, named_files
from balloon_warp.scene import Scene, SceneLike, bundled_scenes
from balloon_warp.scene.load import find_mesh
from balloon_warp.schedules.touch_table import overflow_remarks
from balloon_warp.simulator import Simulator
from balloon_warp.solvers import resolved_solver, solver_named
from balloon_warp.system.api import Shown, checked, described
from balloon_warp.system.files import is_same_file
from balloon_warp.system.process import Interrupts
from balloon_warp.system.warp_threads import lock_of, pick_device

MANY = 50_000
"""Number of worlds whose values take longer to make than the size of one world takes to find"""
SOME = 64
"""Number of worlds at which one takes no more memory than with many: schedules lay out several side by side"""


def require_room(
    scene: Scene,
    world_count: int,
    varied: Collection[str] = (),
    device: str | None = None,
    schedule: str = "auto",
    laws: Sequence[Law] = (),
    spread: bool = False,
) -> None:
    """Make sure that so many worlds could fit, before each gets its values.

    That is where they are very many, and all of one size.

    Args:
        varied: the paths of values that differ.
        device: Warp device; the GPU, or else the CPU, if not given.
        spread: whether workers simulate them, and only the table is here.

    Raises:
        InputError: they could not, or the scene cannot be simulated, or there is no such device or schedule.
    """
    if world_count < MANY or any(map(SHAPING.fullmatch, varied)):
        return
    on_host = table_bytes(scene)
    if not spread:
        shapes = [shape_balloon(balloon, scene, as_soft_as_can_be=True) for balloon in scene.balloon]
        model = lay_out(plan_model(scene, SOME, shapes=shapes, laws=laws), pick_device(device))
        solver = solver_named(resolved_solver(schedule, model, world_count), model)
        simulated = world_bytes(model) + solver.world_bytes(model)
        require_memory(model.device, [world_count], [simulated])
        on_host += simulated if model.device.is_cpu else 0
    require_memory(pick_device("cpu"), [world_count], [on_host])


def require_batch_memory(
    models: Sequence[Model],
    schedules: Sequence[str],
    groups: Sequence[Group],
    chosen: NDArray[np.integer],
    scene: Scene,
    frames_held: int,
    every: int = 0,
) -> None:
    """Make sure that all worlds fit on the device, and the table and some frames of the chosen worlds on the host.

    Args:
        models: of the groups, all on one device.
        schedules: the name of each one's.
        frames_held: frames of the chosen worlds that are in the host's memory at a time.
        every: step between frames that go into files of worlds, and are held likewise; 0 for none.

    Raises:
        InputError: they do not, and the message says how many worlds would; or there is no such schedule.
    """
    counts = [len(group.worlds) for group in groups]
    on_device, on_host = [], []
    for model, schedule, group in zip(models, schedules, groups, strict=True):
        picked = picked_bytes(group.plan) * len(group.rows_of(chosen)) // len(group.worlds)
        simulated = world_bytes(model) + solver_named(schedule, model).world_bytes(model)
        on_device.append(simulated + record_bytes(group.plan) + picked)
        tracked = bytes_of_frame(group.plan) * -(-frames_held // every) if every else 0
        on_host.append(table_bytes(scene) + contact_bytes(group.plan) + frames_held * picked + tracked)
    device = models[0].device
    if device.is_cpu:
        on_host = [sum(both) for both in zip(on_device, on_host, strict=True)]
    else:
        require_memory(device, counts, on_device)
    require_memory(pick_device("cpu"), counts, on_host)


def table_bytes(scene: Scene) -> int:
    """Return the host memory of a world's rows of the table: its measures and its health in every frame."""
    return 4 * (scene.frames + 1) * (len(columns_of(scene)) + 1)


def simulate_locally(
    task: BatchTask,
    device: str | None,
    checkpoints: Checkpoints,
    on_begin: Callable[[RunHeader], None],
    on_frame: Callable[[int], None],
) -> Outcome:
    """Simulate a batch and write its table and its stage.

    Args:
        device: Warp device; the GPU, or else the CPU, if not given.
        checkpoints: which keep the batch safe meanwhile, and from which it goes on.
        on_begin: called once all is laid out.
        on_frame: Called with the number of each simulated frame.

    Raises:
        InputError, BlowUpError, KeyboardInterrupt: as `run_batch`.
    """
    began = time.perf_counter()
    target = pick_device(device)
    with lock_of(target):
        models = [lay_out(group.plan, target) for group in task.groups]
        schedules = [resolved_solver(task.schedule, model, task.world_count) for model in models]
        require_batch_memory(models, schedules, task.groups, task.chosen, task.scene, WAITING + 2, task.every)
        simulators = [Simulator.of_model(*pair) for pair in zip(models, schedules, strict=True)]
    failures, named = Failures(), ", ".join(sorted(set(schedules)))
    on_begin(task.header(str(target), named))
    with BatchOutput(task, task.groups) as output:
        begin = _simulate_frames(task, simulators, output, checkpoints, on_frame)
        with lock_of(target):
            overflow = sum(simulator.schedule.overflow for simulator in simulators)
            remarks = [
                remark
                for simulator, group in zip(simulators, task.groups, strict=True)
                for remark in remarks_on(simulator.model, simulator.state, group.worlds)
            ]
        if output.healthy_count < task.world_count:
            failures = _report_all(task, output, simulators)
            simulators.clear()  # restarted worlds reuse their memory
            if task.on_blowup == "restart":
                bad = task.world_count - output.healthy_count
                checkpoints.on_note(
                    f"{bad:,} of {task.world_count:,} worlds blew up: restarting them with half the step"
                )
                failures.add(_restart_all(task, output, target, schedules))
        endings = output.endings()
        hashes = output.finish()
    return Outcome(
        device=str(target),
        schedule=named,
        workers=1,
        healthy_worlds=output.healthy_count,
        failures=failures,
        bad_endings=endings,
        pairs=output.pairs,
        remarks=remarks,
        overflow=overflow,
        seconds=time.perf_counter() - began,
        resumed=max(begin - 1, 0) / task.scene.frames,
        removed_stage=output.removed_stage,
        hashes=hashes,
    )


def _simulate_frames(
    task: BatchTask,
    simulators: Sequence[Simulator],
    output: BatchOutput,
    checkpoints: Checkpoints,
    on_frame: Callable[[int], None],
) -> int:
    """Simulate all frames of all groups, and write them meanwhile; return the first that was not there already."""
    recorders = [
        Recorder(simulator, group.rows_of(task.chosen), task.every)
        for simulator, group in zip(simulators, task.groups, strict=True)
    ]
    with Interrupts() as interrupts:
        begin = _take_up(checkpoints, output, simulators, recorders)
        output.begin_trajectories(begin > 0)
        record_frames(
            _frames(task, simulators, recorders, begin),
            output,
            checkpoints,
            [recorder.save for recorder in recorders],
            interrupts,
            on_frame,
        )
    return begin


def _frames(
    task: BatchTask, simulators: Sequence[Simulator], recorders: Sequence[Recorder], begin: int
) -> Iterator[tuple[int, list[Record]]]:
    """Simulate frame by frame; yield the number and a record of each group.

    Raises:
        BlowUpError: a world blew up, which is to stop all.
    """
    for number in range(begin, task.scene.frames + 1):
        for simulator in simulators if number else ():
            simulator.advance()
        records = [recorder.read() for recorder in recorders]
        if task.on_blowup == "stop":
            for each in zip(simulators, task.groups, records, strict=True):
                require_health(*each)
        yield number, records


def _take_up(
    checkpoints: Checkpoints, output: BatchOutput, simulators: Sequence[Simulator], recorders: Sequence[Recorder]
) -> int:
    """Take up the frames that an earlier batch saved, where that is wanted; return the first frame that is missing."""
    device = simulators[0].model.device
    begin = 0
    for part in checkpoints.take_up(
        output,
        simulated="in one process",
        device=device.name if device.is_cuda else "cpu",
        schedules=[simulator.schedule.name for simulator in simulators],
    ):
        begin = part.frames.stop
        for _ in part.frames:
            output.end_frame()
    checkpoints.restore(begin, [recorder.restore for recorder in recorders])
    return begin


def _report_all(task: BatchTask, output: BatchOutput, simulators: Sequence[Simulator]) -> Failures:
    """Explain why worlds blew up."""
    failures = Failures()
    for number, each in enumerate(zip(simulators, task.groups, strict=True)):
        failures.add(Failures(report_failures(*each, output.health_of(number))))
    return failures


def _restart_all(task: BatchTask, output: BatchOutput, device: wp.Device, schedules: Sequence[str]) -> Failures:
    """Simulate the worlds that blew up again in shorter steps, and put that in their place."""
    failures = Failures()
    for number, (group, schedule) in enumerate(zip(task.groups, schedules, strict=True)):
        bad, put = np.flatnonzero(output.health_of(number)[-1] == 0), partial(output.replace, number)
        failures.add(Failures([], restart_failures(group, bad, task.chosen, device, schedule, put, task.every)))
    output.rewrite_table()
    return failures


@dataclass(frozen=True)
class Range:
    """Numbers from `low` to `high`."""

    low: float
    high: float


Choice = Range | list[float] | list[str]
"""Range, which is sampled; or list, which is cycled"""


def parse_vary(text: str, scene_source: str = "") -> tuple[str, Choice]:
    """Split `PATH=LOW:HIGH` or `PATH=VALUE,VALUE,...`; only meshes are given by words.

    Args:
        text: the argument of `--vary`.
        scene_source: the scene that the command names; meshes are sought beside its file, too.

    Raises:
        InputError: the text has neither form.
    """
    path, _, words = (part.strip() for part in text.partition("="))
    values = [word.strip() for word in words.split(",")]
    if all(path.split(".")) and all(values):
        if path.split(".")[-1] == "mesh":
            return path, [str(find_mesh(value, scene_source)) for value in values]
        ends = words.split(":")
        numbers = [_number(word) for word in (ends if len(ends) == 2 else values)]
        if None not in numbers:
            if len(ends) != 2:
                return path, [number for number in numbers if number is not None]
            low, high = float(ends[0]), float(ends[1])
            if low < high:
                return path, Range(low, high)
    raise InputError(
        f"--vary {text}: expected PATH=LOW:HIGH with LOW below HIGH, or PATH=NUMBER,NUMBER,..., as in --vary "
        "balloon.inflation.k_normal=0:8 or --vary sphere.0.mass=1,10,100; `compare` also varies words"
    )


def ends_of(choices: Mapping[str, Choice]) -> dict[str, list[float] | list[str]]:
    """Find the ends of ranges, and the values of lists, by their paths."""
    return {
        path: [choice.low, choice.high] if isinstance(choice, Range) else choice for path, choice in choices.items()
    }


def spread(choices: dict[str, Choice], world_count: int, seed: int = 0, grid: bool = False) -> dict[str, NDArray]:
    """Draw a value for each world, as arrays of shape (world_count,).

    Lists are cycled: world w takes value w modulo the list's length. Ranges are sampled uniformly, each from a stream
    of its own, so that a world's value depends on the seed, the path and its number alone; or, with `grid`, are divided
    evenly, ends included: world w takes point w modulo the number of points of the product of all ranges, the first
    range varying fastest, with about as many points on each range and no more points than worlds.
    """
    worlds = np.arange(world_count)
    ranges = {path: choice for path, choice in choices.items() if isinstance(choice, Range)}
    sides = _grid_sides(len(ranges), world_count) if grid else []
    places = np.unravel_index(worlds % math.prod(sides), sides, order="F") if sides else ()
    in_grid = dict(zip(ranges, zip(sides, places, strict=True), strict=True)) if grid else {}
    values: dict[str, NDArray] = {}
    for path, choice in choices.items():
        if not isinstance(choice, Range):
            values[path] = np.array(choice)[worlds % len(choice)]
        elif grid:
            side, place = in_grid[path]
            values[path] = np.linspace(choice.low, choice.high, side)[place]
        else:
            stream = np.random.default_rng([seed, zlib.crc32(path.encode())])
            values[path] = stream.uniform(choice.low, choice.high, len(worlds))
    return values


def parse_export(text: str, world_count: int) -> list[int]:
    """Read the worlds of `all`, `none` or `0,5,9`.

    Raises:
        InputError: it is none of these, or there is no such world.
    """
    if text in ("all", "none"):
        return list(range(world_count)) if text == "all" else []
    try:
        worlds = sorted({int(word) for word in text.split(",")})
    except ValueError:
        raise InputError(f"export {text}: expected all, none, or worlds such as 0,5,9") from None
    for world in worlds:
        if not 0 <= world < world_count:
            raise InputError(f"export {text}: no world {world}, the batch has worlds 0 to {world_count - 1}")
    return worlds


def _grid_sides(range_count: int, world_count: int) -> Sequence[int]:
    """Return the number of points on each range, whose product is at most `world_count`; the first ones get more."""
    if not range_count:
        return []
    sides = [max(int(world_count ** (1.0 / range_count)) - 1, 1)] * range_count  # a root may be rounded up
    grew = True
    while grew:
        grew = False
        for axis in sorted(range(range_count), key=lambda axis: sides[axis]):
            if math.prod(sides) // sides[axis] * (sides[axis] + 1) <= world_count:
                sides[axis] += 1
                grew = True
                break
    return sides


def _number(word: str) -> float | None:
    try:
        number = float(word)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


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
    cluster: BatchPlace | None = None,
    trajectories: TrajectoryFilesLike | None = None,
    table: str = "auto",
    laws: Sequence[Law] = (),
    provenance: Mapping[str, Any] | None = None,
    checkpoint_seconds: float = CHECKPOINT_SECONDS,
    resume: bool = False,
    on_begin: Callable[[RunHeader], None] = lambda header: None,
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
        cluster: `Cluster`, whose workers simulate the batch; this process if not given. The files are the same.
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
    with cluster.started() if cluster else nullcontext(simulate_locally) as simulate:  # workers start while this plans
        files, kind = _files(trajectories, folder), resolved_table(table, world_count * (scene.frames + 1))
        groups = plan_groups(scene, world_count, vary, laws)
        task = BatchTask(scene, groups, vary, chosen, Path(folder), schedule, on_blowup, files, kind)
        checkpoints = batch_checkpoints(task, description := describe_batch(task), checkpoint_seconds, resume, on_note)
        try:
            begin = _warning(task, on_begin, on_warning)
            outcome = simulate(task, device, checkpoints, begin, on_frame)
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
    task: BatchTask, on_begin: Callable[[RunHeader], None], on_warning: Callable[[str], None]
) -> Callable[[RunHeader], None]:
    """Make a listener to the beginning that passes on the warnings about meshes, too."""

    def begin(header: RunHeader) -> None:
        on_begin(header)
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


@checked
def repeat_batch(
    manifest: str | Path,
    folder: str | Path,
    device: str | None = None,
    laws: Sequence[Law] = (),
    *,
    trajectories: str | Path | None = None,
    files: str | Path | None = None,
) -> BatchSummary:
    """Simulate the batch of a manifest again.

    Where versions and device are the same, so are the outputs, byte by byte; the stage of a cluster's batch, whose
    shares came in any order, sample by sample.

    Args:
        manifest: The `manifest.json` of the batch.
        folder: Output folder, as in `run_batch`.
        device: Warp device; the manifest's if not given, and the default one for a batch of a cluster.
        laws: User-defined laws of the batch.
        trajectories: Folder for the batch's files of worlds; they are not written again if not given.
        files: Folder in which, or below which, meshes and other files of the batch lie. They are known by name and
            hash. If not given, they are taken from the current folder, from that of the manifest or the one above it,
            or from the bundled scenes.

    Raises:
        InputError: the manifest cannot be read; a file is not there, has changed or came from Python; a law is not
            there, or has changed; or as `run_batch`.
    """
    batch = _read(Path(manifest))
    find = _finder(Path(manifest), Path(files) if files is not None else None)
    for place, (table, field) in named_files(batch["scene"]).items():
        table[field] = find(table[field], batch["files"].get(place))
    vary = {path: values for path, values in batch["vary"].items() if not path.endswith(SHA256)}
    for path in filter(is_mesh, vary):
        vary[path] = [find(*of_world) for of_world in zip(vary[path], batch["vary"][f"{path}{SHA256}"], strict=True)]
    _require_laws(str(manifest), batch.get("laws", {}), describe_laws(laws))
    return run_batch(
        Scene(**batch["scene"]),
        folder,
        batch["worlds"],
        vary,
        export=batch["export"],
        name=batch.get("name", ""),
        device=device or (batch["device"] if batch["workers"] == 1 else None),
        schedule=batch["schedule_asked"],
        on_blowup=batch.get("on_blowup", "freeze"),
        laws=laws,
        table=batch.get("table", "csv"),
        trajectories=_trajectories(manifest, batch.get("trajectories"), trajectories),
        provenance={"repeats": hash_of_file(Path(manifest))},
    )


def _finder(manifest: Path, folder: Path | None) -> Callable[[str, str | None], str]:
    """Return a function that finds a file by its name and hash.

    It raises an InputError: the file is nowhere, or has changed.
    """
    bundled = next(iter(bundled_scenes().values())).parent

    @cache
    def find(name: str, expected: str | None) -> str:
        places = [Path(), manifest.parent, manifest.parent.parent, bundled]
        near = (place / name for place in places)
        paths = near if folder is None else sorted(path for path in folder.rglob("*") if path.name == name)
        hashes = {path: hash_of_file(path) for path in paths if path.is_file()}
        for path, digest in hashes.items():
            if digest == expected:
                return str(path)
        for path, digest in hashes.items():
            if path.parent != bundled:  # where another of that name is no change
                raise InputError(f"{path}: has changed since the batch: its SHA-256 is {digest}; expected {expected}")
        raise InputError(
            f"{manifest}: its file {name} is missing; expected it in {folder or 'this folder'}, or another as files"
        )

    return find


def _trajectories(manifest: str | Path, said: Any, folder: str | Path | None) -> TrajectoryFiles | None:
    """Return where files of worlds go, written as the batch did."""
    if folder is None:
        return None
    if not isinstance(said, dict):
        raise InputError(f"{manifest}: has no trajectories; expected those of a batch with --trajectories")
    return TrajectoryFiles(**{**said, "folder": folder})


def _require_laws(manifest: str, there: dict[str, Any], here: dict[str, Any]) -> None:
    """Make sure that the laws which are given are those of the batch."""
    for name in there.keys() | here.keys():
        if name not in here:
            raise InputError(f"{manifest}: its law {name} is missing; expected it in laws")
        if name not in there:
            raise InputError(f"{manifest}: has no law {name}; expected {', '.join(there) or 'none'}")
        if there[name] != here[name]:
            raise InputError(f"law {name}: its source has changed since the batch of {manifest}")


def _read(path: Path) -> dict[str, Any]:
    try:
        batch = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as a manifest: {error}") from None
    needed = {"scene", "worlds", "vary", "export", "files", "device", "workers", "schedule_asked"}
    if not isinstance(batch, dict) or not needed <= batch.keys() or not isinstance(batch["scene"], dict):
        raise InputError(f"{path}: is not the manifest of a batch; expected the manifest.json beside its table")
    return batch

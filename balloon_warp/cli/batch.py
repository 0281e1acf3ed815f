"""The command `balloon-warp batch`."""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from balloon_warp.batch.batch import ends_of, parse_export, parse_vary, spread
from balloon_warp.cli.options import (
    LONG,
    MACHINE,
    OUTPUT,
    Changes,
    Device,
    Json,
    LengthOptions,
    MeshOptions,
    Resume,
    SceneName,
    Schedule,
    Set,
)
from balloon_warp.cli.progress import Console, Opening, counted, first_line, frame_progress, note, played, warn, warner
from balloon_warp.errors import InputError
from balloon_warp.farm.local_workers import begin_children
from balloon_warp.run.provenance import command_without_folders
from balloon_warp.scene.load import scene_name
from balloon_warp.system.loading import without_garbage_collection
from balloon_warp.system.warp_setup import begin_driver, quiet_warp

if TYPE_CHECKING:
    from balloon_warp.batch.batch import BatchSummary
    from balloon_warp.batch.trajectories import TrajectoryFiles

WORLDS = "Worlds"
"""Heading of a section of the help"""

Vary = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PATH=LOW:HIGH|PATH=VALUE,...",
        help="Value to vary between worlds: a range, such as balloon.mass=1:3, sampled at random for each world; "
        "or a list, such as sphere.0.mass=1,10 or balloon.mesh=a.obj,b.obj, which the worlds take "
        "in turn. May be repeated.",
        rich_help_panel=WORLDS,
    ),
]
Worlds = Annotated[int, typer.Option(metavar="COUNT", help="Number of worlds.", rich_help_panel=WORLDS)]
Grid = Annotated[
    bool,
    typer.Option(
        "--grid", metavar="", help="Sample ranges on an even grid instead of at random.", rich_help_panel=WORLDS
    ),
]
Seed = Annotated[int, typer.Option(min=0, metavar="NUMBER", help="Seed of the random values.", rich_help_panel=WORLDS)]
Export = Annotated[
    str,
    typer.Option(
        metavar="all|none|0,5,9", help="Worlds that are also written as animated USD.", rich_help_panel=OUTPUT
    ),
]
Output = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FOLDER",
        help="Output folder. SCENE_batch if not given.",
        rich_help_panel=OUTPUT,
    ),
]
TrajectoriesOption = Annotated[
    Path | None,
    typer.Option(
        "--trajectories",
        metavar="FOLDER",
        help="Also write the trajectory of each world as a compressed file in this folder, as training data: "
        "split into train, validation and test by --seed.",
        rich_help_panel=OUTPUT,
    ),
]
TableOption = Annotated[
    str,
    typer.Option(
        "--table",
        metavar="auto|csv|parquet",
        help="Format of the table of all frames beside the .npz. auto: CSV up to 200,000 rows, Parquet for "
        "more where pyarrow is installed.",
        rich_help_panel=OUTPUT,
    ),
]
Every = Annotated[
    int | None, typer.Option(metavar="COUNT", help="Frame stride of --trajectories.", rich_help_panel=OUTPUT)
]
FormatOption = Annotated[
    str | None,
    typer.Option(
        "--format", metavar="h5|zarr|npz", help="Format of --trajectories. h5 if not given.", rich_help_panel=OUTPUT
    ),
]
OnBlowup = Annotated[
    str,
    typer.Option(
        "--on-blowup",
        metavar="freeze|restart|stop",
        help="Action when a world blows up. freeze: keep its last good frame. restart: "
        "restart it with half the step. stop: end the batch.",
        rich_help_panel=LONG,
    ),
]
Gpus = Annotated[
    int | None,
    typer.Option(
        metavar="COUNT", help="Number of GPUs of this machine to spread the worlds over.", rich_help_panel=MACHINE
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(metavar="COUNT", help="Number of processes to spread the worlds over.", rich_help_panel=MACHINE),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="tcp://HOST:PORT",
        help="Spread the worlds over the workers of a Dask scheduler.",
        rich_help_panel=MACHINE,
    ),
]
Checkpoint = Annotated[
    float,
    typer.Option(
        min=0.0,
        metavar="SECONDS",
        help="Interval between checkpoints of a long batch, in FOLDER/partial. 0 saves on Ctrl-C alone.",
        rich_help_panel=LONG,
    ),
]


def batch(
    scene: SceneName,
    *,
    worlds: Worlds = 64,
    vary: Vary = None,
    grid: Grid = False,
    seed: Seed = 0,
    export: Export = "none",
    output: Output = None,
    table: TableOption = "auto",
    trajectories: TrajectoriesOption = None,
    every: Every = None,
    file_format: FormatOption = None,
    overrides: Set = None,
    length: LengthOptions,
    mesh: MeshOptions,
    device: Device = None,
    schedule: Schedule = "auto",
    on_blowup: OnBlowup = "freeze",
    gpus: Gpus = None,
    workers: Workers = None,
    cluster: Scheduler = None,
    checkpoint: Checkpoint = 30.0,
    resume: Resume = False,
    as_json: Json = False,
) -> None:
    """Simulate a batch of varied worlds: a table of all, and USD of the chosen ones.

    Try `balloon-warp batch squirrel_inflate --worlds 9 --vary balloon.mass=1:3 --grid --export all`.
    """
    if workers or (gpus or 0) > 1:
        begin_children()
    changes, name = Changes(overrides, mesh, length), scene_name(scene)
    choices = dict(parse_vary(text, scene) for text in vary or [])
    with _naming_vary():
        loaded = changes.load(scene, ends_of(choices))
    files = _trajectory_files(trajectories, every, file_format, seed)
    spread_over = (cluster, gpus, workers) != (None, None, None)
    if not spread_over:
        begin_driver(device)
    with without_garbage_collection():  # loads much: only once the scene is known to be good
        from balloon_warp.batch.batch import run_batch
        from balloon_warp.batch.local import require_room
        from balloon_warp.farm.cluster import Cluster

    workers_of = Cluster(cluster, gpus, workers, prepare=quiet_warp) if spread_over else None
    require_room(loaded, worlds, choices, device, schedule, spread=spread_over)  # before each gets its values
    with _naming_vary(), frame_progress() as progress:
        task = progress.add_task(escape(name), total=loaded.frames)
        first = first_line(scene, loaded)
        opening = Opening(name, first)
        summary = run_batch(
            loaded,
            output or Path(f"{name}_batch"),
            worlds,
            spread(choices, worlds, seed=seed, grid=grid),
            export=parse_export(export, worlds),
            name=name,
            device=device,
            schedule=schedule,
            on_blowup=on_blowup,
            cluster=workers_of,
            table=table,
            trajectories=files,
            checkpoint_seconds=checkpoint,
            resume=resume,
            provenance={"command": command_without_folders(sys.argv), "seed": seed},
            on_begin=lambda header: opening.add(progress.begin(task, header), header.strain_bound),
            on_frame=opening.before(lambda number: progress.update(task, completed=number)),
            on_note=opening.before(note),
            on_warning=opening.before(warner(first)),
        )
    if worlds > 1 and all(isinstance(values, list) and len(set(values)) == 1 for values in choices.values()):
        note("all worlds are alike; --vary PATH=LOW:HIGH, such as balloon.mass=1:3, makes them differ")
    if as_json:
        print(json.dumps(summary.as_json()))
    else:
        _print_summary(summary, loaded.frames_per_second, spread=spread_over)


def _trajectory_files(
    folder: Path | None, every: int | None, file_format: str | None, seed: int
) -> "TrajectoryFiles | None":
    """Return where trajectories go, and how.

    Raises:
        InputError: it is said how, and not where; or a value cannot be.
    """
    given = {"every": every, "format": file_format}
    asked = {name: value for name, value in given.items() if value is not None}
    if folder is None:
        if asked:
            raise InputError(f"--{next(iter(asked))}: needs --trajectories")
        return None
    from balloon_warp.batch.trajectories import TrajectoryFiles

    return TrajectoryFiles(folder, **asked, seed=seed)


@contextmanager
def _naming_vary() -> Iterator[None]:
    """Name the option of a mistake in values that differ between worlds."""
    from balloon_warp.model.timeline import VaryError

    try:
        yield
    except VaryError as mistake:
        raise InputError(f"--vary {mistake.path}: {str(mistake).removeprefix(f'{mistake.path}: ')}") from None


def _print_summary(summary: "BatchSummary", rate: float, spread: bool) -> None:
    """Print the summary, the failures and the paths of the outputs.

    Args:
        rate: frames a second of the stage.
        spread: whether it was over workers.
    """
    device = f"{summary.workers} x {summary.device}" if spread else summary.device
    console = Console(emoji=False, highlight=False, soft_wrap=True)
    console.print(
        f"{summary.scene}: {counted(summary.worlds, 'world')}, {counted(summary.particles, 'particle')}, "
        f"{counted(summary.frames, 'frame')} of {counted(summary.substeps, 'substep')} in "
        f"{summary.wall_seconds:.1f} s on {device}, schedule {summary.schedule}",
        markup=False,
    )
    for sentence in summary.blow_ups:
        warn(sentence)
    of_all = f"of {summary.worlds:,} worlds blew up"
    if summary.restarted_worlds:
        warn(f"{summary.restarted_worlds:,} {of_all} and were restarted with shorter steps: health 2")
    if summary.unhealthy_worlds:
        warn(f"{summary.unhealthy_worlds:,} {of_all}: health 0; their rows repeat the last good frame")
    stage = [f"{summary.stage}: {played(summary.frames, rate)}"] if summary.stage else []
    folders = [f"{summary.trajectories}: {counted(summary.worlds, 'world')}"] if summary.trajectories else []
    for written in [*summary.table, *summary.worlds_table, *stage, *folders, summary.manifest]:
        console.print(f"wrote {written}", markup=False)
    if summary.removed_stage:
        removed = f"removed {summary.removed_stage} of an earlier batch: this batch exports no worlds"
        console.print(removed, markup=False)

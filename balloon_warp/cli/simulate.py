"""The commands `run`, `view` and `batch`."""

import ipaddress
import json
import re
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from balloon_warp.batch.batch import ends_of, parse_export, parse_vary, spread
from balloon_warp.cli.options import (
    LISTED_ELSEWHERE,
    LONG,
    MACHINE,
    OUTPUT,
    CameraOptions,
    Changes,
    Device,
    Json,
    LengthOptions,
    MeshOptions,
    RenderOptions,
    Resume,
    SceneName,
    Schedule,
    Set,
    command_line,
    own_name,
)
from balloon_warp.cli.progress import Console, Opening, counted, first_line, frame_progress, note, played, warn, warner
from balloon_warp.errors import InputError
from balloon_warp.farm.workers import begin_children
from balloon_warp.run.report import RunHeader, command_without_folders
from balloon_warp.scene.load import scene_name
from balloon_warp.system.process import without_garbage_collection
from balloon_warp.system.warp_setup import begin_driver, quiet_warp

if TYPE_CHECKING:
    from balloon_warp.batch.batch import BatchSummary
    from balloon_warp.batch.trajectories import TrajectoryFiles
    from balloon_warp.run.job import Summary
    from balloon_warp.studio.page.page import Page


@dataclass(frozen=True)
class PageOptions:
    """Options of the page in a browser."""

    open_page: Annotated[bool, typer.Option("--open", metavar="", help="Open the page in the browser.")] = False
    port: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=65535,
            metavar="NUMBER",
            help="Port of the page. If not given, 8080 or the next free one.",
        ),
    ] = None
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="Address to listen on. With 127.0.0.1 only this machine can open the page, with 0.0.0.0 "
            "everybody in your network can.",
        ),
    ] = "127.0.0.1"
    origins: Annotated[
        list[str] | None,
        typer.Option(
            "--origin",
            metavar="https://HOST",
            help="Origin that may show the page besides this machine, such as a reverse proxy. May be repeated.",
        ),
    ] = None


def view(
    scene: SceneName,
    *,
    page: PageOptions,
    folder: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="FOLDER",
            help="Folder of recordings.",
            rich_help_panel=OUTPUT,
        ),
    ] = Path("."),
    overrides: Set = None,
    mesh: MeshOptions,
    device: Device = None,
) -> None:
    """Play with a scene, or any mesh, in the browser: inflate it, pull it, throw things at it.

    Try `balloon-warp view squirrel_tether --open`.
    """
    loaded = Changes(overrides, mesh).load(scene)
    first = first_line(scene, loaded)
    quiet_warp()
    from balloon_warp.studio.page.view import view as play

    def say(shown: "Page") -> None:
        if first:
            note(first)
        _say_where(shown.address, scene_name(scene))
        if not _is_loopback(page.host):
            _say_who_may_come(shown.server.get_port(), folder.resolve())

    play(
        loaded,
        name=scene_name(scene),
        device=device,
        folder=folder,
        host=page.host,
        port=page.port,
        origins=page.origins or [],
        open_page=page.open_page,
        on_start=say,
        on_warning=warner(first),
    )
    Console(emoji=False, highlight=False, soft_wrap=True).print("the page is closed")


def _say_where(address: str, name: str) -> None:
    Console(emoji=False, highlight=False, soft_wrap=True).print(f"{escape(name)} is at {address} (Ctrl-C ends it)")


def _say_who_may_come(port: int, folder: Path) -> None:
    Console(emoji=False, highlight=False, soft_wrap=True).print(
        f"[yellow]warning:[/] anyone who reaches port {port} of this machine can watch and control the page, and save "
        f"recordings into {escape(str(folder))}; it has no encryption and no login"
    )


def _is_loopback(host: str) -> bool:
    """Return whether only this machine reaches an address, or the addresses of a name."""
    places = socket.getaddrinfo(host, None)
    return all(ipaddress.ip_address(place[4][0]).is_loopback for place in places)


Output = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE",
        help="Animation to write. USD: .usdc, .usda, .usd, .usdz. Other kinds: .glb; .abc, which needs "
        "Blender's module; .h5 for arrays; .pvd for ParaView; out.####.ply or out.####.obj for a "
        "file a frame. SCENE.usdc if not given.",
        rich_help_panel=OUTPUT,
    ),
]
Picture = Annotated[
    bool,
    typer.Option(
        "--picture",
        metavar="",
        help="Also make a picture, beside the animation. It takes the camera's options that `balloon-warp render "
        "--help` lists, such as --azimuth 90.",
        rich_help_panel=OUTPUT,
    ),
]
SavePoints = Annotated[
    Path | None,
    typer.Option(
        "--save-points",
        metavar="FILE",
        help="Also write points, edges, velocities and measures as arrays, to this .h5 file for h5py and xarray.",
        rich_help_panel=OUTPUT,
    ),
]
NoLights = Annotated[
    bool,
    typer.Option("--no-lights", metavar="", help="Omit lights, backdrop and camera.", rich_help_panel=OUTPUT),
]
NoGround = Annotated[
    bool,
    typer.Option(
        "--no-ground",
        metavar="",
        help="Omit ground and backdrop: they are so wide that a program that frames everything shows little else.",
        rich_help_panel=OUTPUT,
    ),
]
OnBlowup = Annotated[
    str,
    typer.Option(
        "--on-blowup",
        metavar="stop|freeze|restart",
        help="Action when the simulation blows up. stop: write nothing. freeze: write the frames "
        "until then. restart: restart with half the step.",
        rich_help_panel=LONG,
    ),
]
Checkpoint = Annotated[
    float,
    typer.Option(
        min=0.0,
        metavar="SECONDS",
        help="Interval between checkpoints of a long run, in FILE.partial. 0 saves on Ctrl-C alone.",
        rich_help_panel=LONG,
    ),
]
WHERE_TO = (
    "output",
    "picture",
    "save_points",
    "checkpoint",
    "resume",
    "as_json",
    "force",
    *RenderOptions.__annotations__,
)
"""Parameters that do not change the content of the stage"""


def run(
    context: typer.Context,
    scene: SceneName,
    *,
    output: Output = None,
    picture: Picture = False,
    camera: Annotated[CameraOptions, LISTED_ELSEWHERE],
    save_points: SavePoints = None,
    no_lights: NoLights = False,
    no_ground: NoGround = False,
    overrides: Set = None,
    length: LengthOptions,
    mesh: MeshOptions,
    device: Device = None,
    schedule: Schedule = "auto",
    on_blowup: OnBlowup = "stop",
    checkpoint: Checkpoint = 30.0,
    resume: Resume = False,
    as_json: Json = False,
) -> None:
    """Simulate a scene, or any mesh, and write it as animated USD.

    Try `balloon-warp run squirrel_tether --picture`, then `balloon-warp run YOUR_MESH.obj --picture`.
    """
    asked = camera.asked()
    if any(asked.values()) and not picture:
        name = next(name for name, value in asked.items() if value)
        raise InputError(f"--{name.replace('_', '-')}: needs --picture")
    loaded = Changes(overrides, mesh, length).load(scene)
    name = scene_name(scene)
    usual = f"{name}_balloon.usdc" if Path(scene).suffix.startswith(".usd") else f"{name}.usdc"
    stage = output or own_name(Path(usual), loaded)
    beside = own_name(picture_beside(stage), loaded) if picture else None
    begin_driver(device)
    from balloon_warp.studio.animate import animate  # loads Warp and USD: only once the scene is known to be good

    with frame_progress() as progress:
        task = progress.add_task(escape(name), total=loaded.frames)
        first = first_line(scene, loaded)
        opening = Opening(name, first)

        def begin(header: RunHeader) -> None:
            about_substeps = header.strain_bound, header.many_substeps
            opening.add(progress.begin(task, header), *about_substeps, then=header.coarse)

        summary = animate(
            loaded,
            stage,
            name=name,
            picture=beside,
            save_points=save_points,
            lights=not no_lights,
            ground=not no_ground,
            device=device,
            schedule=schedule,
            on_blowup=on_blowup,
            provenance={"command": command_line(context, WHERE_TO)},
            checkpoint_seconds=checkpoint,
            resume=resume,
            view=asked,
            on_begin=begin,
            on_frame=opening.before(lambda number: progress.update(task, completed=number)),
            on_note=opening.before(note),
            on_warning=opening.before(warner(first)),
        )
    if as_json:
        print(json.dumps(summary.as_json()))
    else:
        _print_summary(summary, loaded.frames_per_second)


def _lasting(summary: "Summary", rate: float) -> str:
    """Return the duration of the stage, and the frame rate to set in Blender."""
    kind = Path(summary.output).suffix.lower()
    if kind in (".obj", ".ply"):
        return f"{counted(summary.frames + 1, 'file')}, {rate:g} per second"
    return played(summary.frames, rate, hint=kind.startswith((".usd", ".abc")))


def picture_beside(output: Path) -> Path:
    """Return the path of an output's picture; the output's name may have #### for frames."""
    return output.with_name(f"{re.sub('[.]?#+', '', output.stem, count=1) or 'picture'}.png")


def _print_summary(summary: "Summary", rate: float) -> None:
    """Print the summary and the paths of the outputs.

    Args:
        rate: frames a second of the stage.
    """
    console = Console(emoji=False, highlight=False, soft_wrap=True)
    resumed = f", the last {summary.frames - summary.begin}" if summary.begin else ""
    where = f"on {summary.device}, schedule {summary.schedule}"
    console.print(
        f"{summary.scene}: {counted(summary.particles, 'particle')}, {counted(summary.springs, 'spring')}, "
        f"{counted(summary.frames, 'frame')} of {counted(summary.substeps, 'substep')}{resumed} in "
        f"{summary.wall_seconds:.1f} s {where}",
        markup=False,
    )
    console.print(f"wrote {summary.output}: {_lasting(summary, rate)}", markup=False)
    if summary.points:
        console.print(f"wrote {summary.points}", markup=False)
    if summary.picture:
        console.print(f"wrote {summary.picture}", markup=False)


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
OutputFolder = Annotated[
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
OnBlowupOfWorld = Annotated[
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
BatchCheckpoint = Annotated[
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
    output: OutputFolder = None,
    table: TableOption = "auto",
    trajectories: TrajectoriesOption = None,
    every: Every = None,
    file_format: FormatOption = None,
    overrides: Set = None,
    length: LengthOptions,
    mesh: MeshOptions,
    device: Device = None,
    schedule: Schedule = "auto",
    on_blowup: OnBlowupOfWorld = "freeze",
    gpus: Gpus = None,
    workers: Workers = None,
    cluster: Scheduler = None,
    checkpoint: BatchCheckpoint = 30.0,
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
        from balloon_warp.batch.batch import require_room, run_batch
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
        _print_batch_summary(summary, loaded.frames_per_second, spread=spread_over)


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
    from balloon_warp.model.parameters import VaryError

    try:
        yield
    except VaryError as mistake:
        raise InputError(f"--vary {mistake.path}: {str(mistake).removeprefix(f'{mistake.path}: ')}") from None


def _print_batch_summary(summary: "BatchSummary", rate: float, spread: bool) -> None:
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

"""`balloon-warp batch`"""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.markup import escape

from balloon_warp.cli.options import Device, SceneName, Schedule, UnitOption, Weld, first_line, scene_changes
from balloon_warp.cli.progress import frame_progress
from balloon_warp.cli.quiet import quiet_warp
from balloon_warp.cli.warn import note, opened_by, warn
from balloon_warp.cli.words import counted
from balloon_warp.scene.load import load_scene, scene_name

if TYPE_CHECKING:
    from balloon_warp.sweep.batch import BatchSummary

Vary = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PATH=LOW:HIGH|VALUE,...",
        help="What differs: a range is sampled, --vary balloon.mass=1:3; a list is cycled, "
        "--vary sphere.0.mass=1,10 or --vary balloon.mesh=a.obj,b.obj.",
    ),
]
OnBlowup = Annotated[
    str,
    typer.Option(
        "--on-blowup",
        metavar="freeze|restart|stop",
        help="What becomes of a world that blows up: it stays at its last good frame, begins again with half the "
        "step, or ends the batch.",
    ),
]
Checkpoint = Annotated[
    float,
    typer.Option(
        min=0.0,
        metavar="SECONDS",
        help="How often a long batch is saved, in OUTPUT/partial, from where --resume goes on; 0 for only when it "
        "is stopped with Ctrl-C.",
    ),
]


def batch(
    scene: SceneName,
    *,
    worlds: Annotated[int, typer.Option(help="How many worlds.")] = 64,
    vary: Vary = None,
    grid: Annotated[bool, typer.Option("--grid", help="Divide the ranges evenly instead of sampling them.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Of the samples.")] = 0,
    export: Annotated[
        str, typer.Option(metavar="all|none|0,5,9", help="The worlds that are written as animated USD, too.")
    ] = "none",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder to write into; SCENE_batch if not given.")
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="PATH=VALUE", help="Change a value of all worlds: --set balloon.mass=0.2"),
    ] = None,
    weld: Weld = False,
    unit: UnitOption = None,
    device: Device = None,
    schedule: Schedule = "auto",
    on_blowup: OnBlowup = "freeze",
    gpus: Annotated[int | None, typer.Option(help="Spread the worlds over this many GPUs of this machine.")] = None,
    workers: Annotated[int | None, typer.Option(help="Spread the worlds over this many processes on the CPU.")] = None,
    cluster: Annotated[
        str | None,
        typer.Option(metavar="tcp://HOST:PORT", help="Spread the worlds over the workers of a Dask scheduler."),
    ] = None,
    checkpoint: Checkpoint = 30.0,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on from where a batch that was stopped or killed was saved.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print a summary as JSON on standard output.")] = False,
) -> None:
    """Simulate many worlds that differ: a table of all, and USD of those that you choose."""
    loaded = load_scene(scene, scene_changes(overrides, weld, unit))
    name = scene_name(scene)
    quiet_warp()
    from balloon_warp.sweep.batch import run_batch  # loads Warp and USD: only once the scene is known to be good
    from balloon_warp.sweep.cluster import Cluster
    from balloon_warp.sweep.values import parse_export, parse_vary, spread

    spread_over = None
    if (cluster, gpus, workers) != (None, None, None):
        spread_over = Cluster(cluster, gpus, workers, prepare=quiet_warp)
    choices = dict(parse_vary(text, scene) for text in vary or [])
    with frame_progress() as progress:
        task = progress.add_task(escape(name), total=loaded.frames)
        listeners = (lambda number: progress.update(task, completed=number)), note, warn
        on_frame, on_note, on_warning = opened_by(first_line(scene, loaded), *listeners)
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
            cluster=spread_over,
            checkpoint_seconds=checkpoint,
            resume=resume,
            provenance={"command": sys.argv, "folder": str(Path.cwd()), "seed": seed},
            on_frame=on_frame,
            on_note=on_note,
            on_warning=on_warning,
        )
    if not choices and worlds > 1:
        note("all worlds are alike; --vary PATH=LOW:HIGH, such as balloon.mass=1:3, makes them differ")
    if as_json:
        print(json.dumps(summary.as_json()))
    else:
        _print_summary(summary, spread=bool(spread_over))


def _print_summary(summary: "BatchSummary", spread: bool) -> None:
    """What was done, what went wrong, and where it is.

    Args:
        spread: whether it was over workers.
    """
    device = f"{summary.workers} x {summary.device}" if spread else summary.device
    console = Console(highlight=False, soft_wrap=True)
    console.print(
        f"{summary.scene}: {counted(summary.worlds, 'world')}, {counted(summary.particles, 'particle')}, "
        f"{counted(summary.frames, 'frame')} of {counted(summary.substeps, 'substep')} in "
        f"{summary.wall_seconds:.1f} s on {device} ({summary.schedule})",
        markup=False,
    )
    for sentence in summary.blow_ups:
        warn(sentence)
    of_all = f"of {summary.worlds:,} worlds blew up"
    if summary.restarted_worlds:
        warn(f"{summary.restarted_worlds:,} {of_all}, but not in shorter steps: health 2")
    if summary.unhealthy_worlds:
        warn(f"{summary.unhealthy_worlds:,} {of_all}: health 0, and the rows of the last good frame")
    for path in [*summary.table, *([summary.stage] if summary.stage else []), summary.manifest]:
        console.print(f"wrote {path}", markup=False)
    if summary.removed_stage:
        removed = f"removed {summary.removed_stage}, which was an earlier batch's: this one exports no worlds"
        console.print(removed, markup=False)

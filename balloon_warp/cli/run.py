"""`balloon-warp run`"""

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from balloon_warp.cli.command import command_line
from balloon_warp.cli.options import Device, SceneName, Schedule, UnitOption, Weld, first_line, scene_changes
from balloon_warp.cli.progress import frame_progress
from balloon_warp.cli.quiet import quiet_warp
from balloon_warp.cli.warn import note, opened_by, warn
from balloon_warp.cli.words import counted
from balloon_warp.scene.load import load_scene, scene_name

WHERE_TO = ("output", "picture", "checkpoint", "resume", "as_json")
"""parameters that do not change what is in the stage"""


def run(
    context: typer.Context,
    scene: SceneName,
    *,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Stage to write: .usdc, .usda or .usd; SCENE.usdc if not given."),
    ] = None,
    picture: Annotated[bool, typer.Option("--picture", help="Render a picture beside the stage, too.")] = False,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="PATH=VALUE", help="Change a value: --set balloon.inflation.k_normal=3"),
    ] = None,
    weld: Weld = False,
    unit: UnitOption = None,
    device: Device = None,
    schedule: Schedule = "auto",
    on_blowup: Annotated[
        str,
        typer.Option(
            "--on-blowup",
            metavar="stop|freeze|restart",
            help="If the simulation blows up: write nothing, the frames until then, or all, with half the step.",
        ),
    ] = "stop",
    checkpoint: Annotated[
        float,
        typer.Option(
            min=0.0,
            metavar="SECONDS",
            help="How often a long run is saved, in OUTPUT.partial, from where --resume goes on; 0 for only when it "
            "is stopped with Ctrl-C.",
        ),
    ] = 30.0,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on from where a run that was stopped or killed was saved.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print a summary as JSON on standard output.")] = False,
) -> None:
    """Simulate a scene, or any mesh, and write it as animated USD."""
    loaded = load_scene(scene, scene_changes(overrides, weld, unit))
    name = scene_name(scene)
    stage = output or Path(f"{name}_balloon.usdc" if Path(scene).suffix.startswith(".usd") else f"{name}.usdc")
    quiet_warp()
    from balloon_warp.job import animate  # loads Warp and USD: only once the scene is known to be good

    with frame_progress() as progress:
        task = progress.add_task(escape(name), total=loaded.frames)
        listeners = (lambda number: progress.update(task, completed=number)), note, warn
        on_frame, on_note, on_warning = opened_by(first_line(scene, loaded), *listeners)
        summary = animate(
            loaded,
            stage,
            name=name,
            picture=stage.with_suffix(".png") if picture else None,
            device=device,
            schedule=schedule,
            on_blowup=on_blowup,
            provenance={"command": command_line(context, WHERE_TO)},
            checkpoint_seconds=checkpoint,
            resume=resume,
            on_frame=on_frame,
            on_note=on_note,
            on_warning=on_warning,
        )
    if as_json:
        print(json.dumps(summary.as_json()))
        return
    console = Console(highlight=False, soft_wrap=True)
    resumed = f", the last {summary.frames - summary.begin}" if summary.begin else ""
    where = f"on {summary.device} ({summary.schedule})"
    console.print(
        f"{summary.scene}: {counted(summary.particles, 'particle')}, {counted(summary.springs, 'spring')}, "
        f"{counted(summary.frames, 'frame')} of {counted(summary.substeps, 'substep')}{resumed} in "
        f"{summary.wall_seconds:.1f} s {where}",
        markup=False,
    )
    for path in (summary.output, summary.picture):
        if path:
            console.print(f"wrote {path}", markup=False)

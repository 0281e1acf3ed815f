"""`balloon-warp render`"""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress

from balloon_warp.cli.options import Device
from balloon_warp.cli.size import parse_size
from balloon_warp.quiet import quiet_warp


def render(
    stage: Annotated[Path, typer.Argument(metavar="STAGE", help="A USD file: of `run`, or any with meshes in it.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="The picture: .png, .gif or .mp4; STAGE.png if not given."),
    ] = None,
    frame: Annotated[
        int | None,
        typer.Option(
            metavar="NUMBER",
            help="The frame of a .png; if not given, the one that the stage names, else the last.",
        ),
    ] = None,
    size: Annotated[str, typer.Option(metavar="WIDTHxHEIGHT", help="In pixels.")] = "960x540",
    azimuth: Annotated[
        float | None,
        typer.Option(
            metavar="DEGREES", help="Look from there: 0 is the front, 90 the right, 180 the back; 32 if not given."
        ),
    ] = None,
    elevation: Annotated[
        float | None, typer.Option(metavar="DEGREES", help="Look from so far above: 90 is the top; 13 if not given.")
    ] = None,
    samples: Annotated[int, typer.Option(metavar="COUNT", help="Rays for each pixel: more is smoother.")] = 4,
    device: Device = None,
) -> None:
    """Make a picture or an animation of a stage. This needs no display.

    Try `balloon-warp render squirrel_tether.usdc -o squirrel.mp4 --azimuth 90`.
    """
    pixels = parse_size(size)
    quiet_warp()
    from balloon_warp.outputs.render import render_stage  # loads USD: only once the arguments are known to be good

    picture = output or Path(stage.with_suffix(".png").name)
    terminal = Console(stderr=True)
    with Progress(console=terminal, disable=not terminal.is_terminal, transient=True) as progress:
        task = progress.add_task(picture.name, total=None)
        render_stage(
            stage,
            picture,
            frame=frame,
            size=pixels,
            samples=samples,
            device=device,
            azimuth=azimuth,
            elevation=elevation,
            on_frame=lambda done, count: progress.update(task, completed=done, total=count),
        )
    Console(highlight=False, soft_wrap=True).print(f"wrote {picture}", markup=False)

"""`balloon-warp render`"""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress

from balloon_warp.cli.options import Device
from balloon_warp.cli.size import parse_frames, parse_place, parse_size
from balloon_warp.quiet import quiet_warp

CAMERA = "Where one looks"
"""a part of the help"""

Azimuth = Annotated[
    float | None,
    typer.Option(
        metavar="DEGREES",
        help="From there: 0 is the front, 90 the right, 180 the back; 32 if not given.",
        rich_help_panel=CAMERA,
    ),
]
Elevation = Annotated[
    float | None,
    typer.Option(metavar="DEGREES", help="From so far above: 90 is the top; 13 if not given.", rich_help_panel=CAMERA),
]
Zoom = Annotated[
    float,
    typer.Option(
        metavar="FACTOR", help="Show everything so many times as large: 2 is twice as near.", rich_help_panel=CAMERA
    ),
]
LookAt = Annotated[
    str | None,
    typer.Option(
        "--look-at",
        metavar="NAME|X,Y,Z",
        help="What is in the middle: a thing of the stage, such as String_0, or a point; all that moves if not given.",
        rich_help_panel=CAMERA,
    ),
]
Follow = Annotated[
    bool,
    typer.Option(
        "--follow",
        metavar="",
        help="Go along with the balloons, or with what --look-at names.",
        rich_help_panel=CAMERA,
    ),
]


def render(
    stage: Annotated[Path, typer.Argument(metavar="STAGE", help="A USD file: of `run`, or any with meshes in it.")],
    *,
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
    azimuth: Azimuth = None,
    elevation: Elevation = None,
    zoom: Zoom = 1.0,
    look_at: LookAt = None,
    follow: Follow = False,
    frames: Annotated[
        str | None, typer.Option(metavar="FIRST:LAST", help="The part of an animation to show, such as 10:90.")
    ] = None,
    fps: Annotated[
        float | None,
        typer.Option(metavar="RATE", help="Pictures a second of an animation, which keeps its true speed."),
    ] = None,
    samples: Annotated[int, typer.Option(metavar="COUNT", help="Rays for each pixel: more is smoother.")] = 4,
    device: Device = None,
) -> None:
    """Make a picture or an animation of a stage. This needs no display.

    Try `balloon-warp render squirrel_tether.usdc -o squirrel.mp4 --azimuth 90`.
    """
    pixels = parse_size(size)
    place = parse_place(look_at) if look_at else None
    part = parse_frames(frames) if frames else None
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
            zoom=zoom,
            look_at=place,
            follow=follow,
            frames=part,
            frames_per_second=fps,
            on_frame=lambda done, count: progress.update(task, completed=done, total=count),
        )
    Console(highlight=False, soft_wrap=True).print(f"wrote {picture}", markup=False)

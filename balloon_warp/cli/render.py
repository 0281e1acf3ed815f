"""The command `balloon-warp render`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.progress import Progress

from balloon_warp.cli.names import own_name
from balloon_warp.cli.options import CameraOptions, RenderDevice, parse_frames, parse_size
from balloon_warp.cli.progress import Console, warn
from balloon_warp.warp_logging import quiet_warp


def render(
    stage: Annotated[
        Path, typer.Argument(metavar="STAGE", help="A USD file that `run` wrote, or any other with meshes in it.")
    ],
    *,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Picture to write: .png, .webp, .gif or .mp4. STAGE.png if not given.",
        ),
    ] = None,
    frame: Annotated[
        int | None,
        typer.Option(
            metavar="NUMBER",
            help="Frame that a .png shows. If not given, the stage's picture frame, or the last.",
        ),
    ] = None,
    size: Annotated[str, typer.Option(metavar="WIDTHxHEIGHT", help="Size of the picture in pixels.")] = "960x540",
    camera: CameraOptions,
    frames: Annotated[
        str | None, typer.Option(metavar="FIRST:LAST", help="Range of frames of an animation, such as 10:90.")
    ] = None,
    fps: Annotated[
        float | None,
        typer.Option(metavar="RATE", help="Frame rate of the animation, which keeps its true speed."),
    ] = None,
    samples: Annotated[int, typer.Option(metavar="COUNT", help="Rays per pixel. More is smoother and slower.")] = 4,
    device: RenderDevice = None,
) -> None:
    """Render a picture or an animation of a stage. No display is needed.

    Try `balloon-warp render squirrel_tether.usdc -o squirrel.mp4 --azimuth 90`.
    """
    asked = camera.asked()
    pixels = parse_size(size)
    part = parse_frames(frames) if frames else None
    quiet_warp()
    from balloon_warp.outputs.render import render_stage  # loads USD: only once the arguments are known to be good

    picture = output or own_name(Path(stage.with_suffix(".png").name))
    terminal = Console(emoji=False, stderr=True)
    with Progress(console=terminal, disable=not terminal.is_terminal, transient=True) as progress:
        task = progress.add_task(picture.name, total=None)
        render_stage(
            stage,
            picture,
            frame=frame,
            size=pixels,
            samples=samples,
            device=device,
            frames=part,
            frames_per_second=fps,
            on_frame=lambda done, count: progress.update(task, completed=done, total=count),
            on_note=warn,
            **asked,
        )
    Console(emoji=False, highlight=False, soft_wrap=True).print(f"wrote {picture}", markup=False)

"""The command `balloon-warp convert`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.progress import Progress

from balloon_warp.cli.progress import Console, note


def convert(
    stage: Annotated[
        Path, typer.Argument(metavar="STAGE", help="A USD file that `run` or `batch` wrote, or any other.")
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="File to write. USD: .usdc, .usda, .usd, .usdz. Other kinds: .glb; .abc, which needs "
            "Blender's module; .h5 for arrays; .pvd for ParaView; out.####.ply or out.####.obj for a "
            "file a frame.",
        ),
    ],
) -> None:
    """Convert an animated stage to another format.

    Try `balloon-warp convert squirrel_tether.usdc -o squirrel.glb`.
    """
    from balloon_warp.outputs.exports import export_stage

    terminal = Console(emoji=False, stderr=True)
    with Progress(console=terminal, disable=not terminal.is_terminal, transient=True) as progress:
        task = progress.add_task(output.name, total=None)
        export_stage(
            stage,
            output,
            on_note=note,
            on_frame=lambda done, count: progress.update(task, completed=done, total=count),
        )
    Console(emoji=False, highlight=False, soft_wrap=True).print(f"wrote {output}", markup=False)

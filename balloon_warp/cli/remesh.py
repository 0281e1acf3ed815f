"""`balloon-warp remesh`"""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from balloon_warp.cli.quiet import quiet_warp
from balloon_warp.errors import InputError
from balloon_warp.mesh.frame import in_y_up_meters
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.obj import write_obj


def remesh(
    mesh: Annotated[Path, typer.Argument(help="A mesh: OBJ or USD, STL, PLY, OFF, glTF or GLB; holes are closed.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The OBJ file to write.")],
    cells: Annotated[int, typer.Option(help="Quads along the longest side, about: 4 to 256.")] = 48,
) -> None:
    """Make a closed mesh of even quads of any surface, so that it makes a good balloon."""
    if output.suffix.lower() != ".obj":
        raise InputError(f"--output {output}: expected a name that ends in .obj")
    surface = load_mesh(mesh)
    quiet_warp()
    from balloon_warp.mesh.remesh import remesh as remeshed  # loads Warp: only once there is a mesh

    quads = in_y_up_meters(remeshed(surface, cells))
    write_obj(output, quads)
    console = Console(highlight=False, soft_wrap=True)
    for warning in quads.warnings:
        console.print(f"[yellow]warning:[/] {escape(warning)}")
    console.print(f"wrote {escape(str(output))}: {quads.vertex_count:,} vertices, {quads.face_count:,} quads")

"""`balloon-warp foil`"""

from pathlib import Path
from typing import Annotated

import typer

from balloon_warp.files import check_writable
from balloon_warp.foil.make import HEIGHT, foil_mesh, foil_parts
from balloon_warp.mesh.obj import LOADERS, write_obj

Edge = Annotated[
    float | None,
    typer.Option(
        metavar="METERS", help="About how long the edges of the quads are. If not given, a 32nd of the height or less."
    ),
]
Font = Annotated[
    str | None,
    typer.Option(metavar="FONT", help="A .ttf or .otf file, or the name of a font. DejaVu Sans Bold if not given."),
]


def foil(
    source: Annotated[str, typer.Argument(metavar="TEXT|DRAWING", help="Letters, or an .svg file.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="The mesh to write, an .obj file.")],
    height: Annotated[float, typer.Option(metavar="METERS", help="How high all of it is.")] = HEIGHT,
    edge: Edge = None,
    font: Font = None,
    apart: Annotated[
        bool,
        typer.Option("--apart", metavar="", help="Write a file for each letter or part: FILE_1.obj and so on."),
    ] = False,
) -> None:
    """Make a foil balloon of letters or a drawing: two flat sheets of even quads, sewn at the rim.

    Try `balloon-warp foil HEY --apart -o hey.obj`. `balloon-warp run foil_letters` shows how such letters fill. This
    needs the extra `foil`.
    """
    check_writable(output, tuple(LOADERS))
    if apart:
        meshes = foil_parts(source, height, edge, font)
        paths = [output.with_stem(f"{output.stem}_{number}") for number in range(1, len(meshes) + 1)]
    else:
        meshes, paths = [foil_mesh(source, height, edge, font)], [output]
    for path, mesh in zip(paths, meshes, strict=True):
        write_obj(path, mesh)
        print(f"wrote {path}: {mesh.vertex_count:,} vertices, {mesh.face_count:,} quads")

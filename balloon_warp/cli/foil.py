"""The command `balloon-warp foil`."""

from pathlib import Path
from typing import Annotated

import typer

from balloon_warp.files import check_writable
from balloon_warp.foil.make import HEIGHT, foil_mesh, foil_parts
from balloon_warp.mesh.obj import LOADERS, write_obj
from balloon_warp.scene.of_foil import scene_of_foil
from balloon_warp.scene.write import write_scene

SCENE = ".toml"

Edge = Annotated[
    float | None,
    typer.Option(
        metavar="METERS", help="Approximate edge length of the quads. If not given, a 32nd of the height or less."
    ),
]
Font = Annotated[
    str | None,
    typer.Option(metavar="FONT", help="A .ttf or .otf file, or the name of a font. DejaVu Sans Bold if not given."),
]


def foil(
    source: Annotated[str, typer.Argument(metavar="TEXT|DRAWING", help="Letters, or an .svg file.")],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Mesh to write, .obj; or scene, .toml, in which each letter or part is a balloon that inflates, "
            "with its meshes beside it.",
        ),
    ],
    height: Annotated[float, typer.Option(metavar="METERS", help="Height of the whole text or drawing.")] = HEIGHT,
    edge: Edge = None,
    font: Font = None,
    apart: Annotated[
        bool,
        typer.Option("--apart", metavar="", help="Write a file for each letter or part: FILE_1.obj and so on."),
    ] = False,
) -> None:
    """Make a foil balloon of letters or a drawing: two flat sheets of even quads, sewn at the rim.

    Try `balloon-warp foil HEY -o hey.toml`, then `balloon-warp run hey.toml --picture`. This needs the extra `foil`.
    """
    check_writable(output, (*LOADERS, SCENE))
    is_scene = output.suffix.lower() == SCENE
    if apart or is_scene:
        parts = enumerate(foil_parts(source, height, edge, font), start=1)
        meshes = {output.with_name(f"{output.stem}_{number}.obj"): mesh for number, mesh in parts}
    else:
        meshes = {output: foil_mesh(source, height, edge, font)}
    for path, mesh in meshes.items():
        write_obj(path, mesh)
        print(f"wrote {path}: {mesh.vertex_count:,} vertices, {mesh.face_count:,} quads")
    if is_scene:
        write_scene(scene_of_foil(meshes, height), output)
        print(f"wrote {output}: balloon-warp run {output} fills them")

"""The command `balloon-warp foil`."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from balloon_warp.cli.progress import stages
from balloon_warp.errors import InputError
from balloon_warp.files import check_writable, require_ours
from balloon_warp.foil.make import HEIGHT, foil_mesh, foil_parts, joined
from balloon_warp.mesh.obj import LOADERS, write_obj
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.scene import Scene
from balloon_warp.scene.around import scene_of_foil
from balloon_warp.scene.write import write_scene
from balloon_warp.warp_logging import quiet_warp

SCENE, MESH = ".toml", ".obj"
SceneOf = Callable[[Mapping[Path, PolygonMesh]], Scene]
"""Function from meshes, by their files, to a scene"""

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
    height: Annotated[
        float | None,
        typer.Option(
            metavar="METERS", help=f"Height of the whole text or drawing, flat. {HEIGHT:g} if neither size is given."
        ),
    ] = None,
    inflated_size: Annotated[
        float | None,
        typer.Option(
            "--inflated-size",
            metavar="METERS",
            help="Largest dimension of the inflated outline. The flat outline is corrected until it inflates to "
            "the drawn one; a scene is then of film, without strings.",
        ),
    ] = None,
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
    if output.suffix.lower() == SCENE:
        require_ours(output)
    if height is not None and inflated_size is not None:
        raise InputError("--inflated-size, --height: expected only one of them, the inflated size or the flat height")
    in_files = apart or output.suffix.lower() == SCENE
    if inflated_size is not None:
        parts, scene = _of_inflated_size(source, inflated_size, edge, font)
    else:
        flat = HEIGHT if height is None else height
        parts = foil_parts(source, flat, edge, font) if in_files else [foil_mesh(source, flat, edge, font)]
        scene = partial(scene_of_foil, height=flat)
    _write(parts if in_files else [joined(parts, Path(source).stem)], output, in_files, scene)


def _of_inflated_size(
    source: str, size: float, edge: float | None, font: str | None
) -> tuple[list[PolygonMesh], SceneOf]:
    """Return the parts that have the drawn outline once they are inflated, and how they make a scene."""
    from balloon_warp.designing.foil import foil_of_inflated_size  # loads Warp

    quiet_warp()
    with stages(source) as stage:
        found, parts = foil_of_inflated_size(source, size, edge, font, stage)
        stage.end()
    return parts, lambda meshes: found.scene(list(meshes.values()), list(meshes))


def _write(parts: list[PolygonMesh], output: Path, apart: bool, scene_of: SceneOf) -> None:
    """Write the meshes, each in a file of its own or one in OUTPUT, and the scene."""
    is_scene = output.suffix.lower() == SCENE
    meshes = {output: parts[0]}
    if apart:
        meshes = {output.with_name(f"{output.stem}_{number}{MESH}"): part for number, part in enumerate(parts, start=1)}
        for path in meshes:
            require_ours(path)
    for path, mesh in meshes.items():
        write_obj(path, mesh)
        print(f"wrote {path}: {mesh.vertex_count:,} vertices, {mesh.face_count:,} quads")
    if is_scene:
        write_scene(scene_of(meshes), output)
        print(f"wrote {output}: balloon-warp run {output} inflates the balloons")

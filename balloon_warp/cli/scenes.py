"""The command `balloon-warp scenes`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from balloon_warp.cli.options import Changes, MeshOptions
from balloon_warp.cli.progress import Console
from balloon_warp.errors import InputError
from balloon_warp.scene.load import bundled_scenes, load_scene
from balloon_warp.scene.write import scene_toml, write_scene


def scenes(
    scene: Annotated[
        str | None,
        typer.Argument(
            help="Bundled scene, scene file or mesh to start your own scene from. If not given, "
            "all bundled scenes are listed.",
            metavar="SCENE",
        ),
    ] = None,
    *,
    mesh: MeshOptions,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Scene file to write, .toml. If not given, it is printed."),
    ] = None,
) -> None:
    """List the bundled scenes, or write one as a file to edit.

    Try `balloon-warp scenes squirrel_tether -o mine.toml`, then `balloon-warp run mine.toml`.
    """
    if scene is None:
        if output or mesh.inflate is not None:
            option = f"--output {output}" if output else f"--inflate {mesh.inflate:g}"
            raise InputError(f"{option}: needs a SCENE to write")
        _list_scenes()
        return
    loaded = Changes(mesh=mesh).load(scene)
    if output is None:
        print(scene_toml(loaded, Path()), end="")
        return
    for path in write_scene(loaded, output):
        Console(emoji=False, highlight=False, soft_wrap=True).print(f"wrote {path}", markup=False)


def _list_scenes() -> None:
    table = Table(box=None, pad_edge=False)
    table.add_column("scene", style="bold", no_wrap=True)
    table.add_column("what it shows")
    for name in bundled_scenes():
        table.add_row(name, load_scene(name).description)
    Console(emoji=False, highlight=False).print(table)

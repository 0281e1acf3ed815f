"""What several commands take, said once."""

from pathlib import Path
from typing import Annotated

import typer

from balloon_warp.errors import InputError
from balloon_warp.mesh.units import METERS
from balloon_warp.scene import Scene, bundled_scenes
from balloon_warp.scene.overrides import Override, parse_override

WELD: Override = ("balloon.weld", True)
"""what --weld stands for"""

SceneName = Annotated[str, typer.Argument(help="A bundled scene (see `balloon-warp scenes`), a scene file, or a mesh.")]
Weld = Annotated[
    bool,
    typer.Option("--weld", help="Join faces where vertices lie at exactly the same place: --set balloon.weld=true"),
]
UnitOption = Annotated[
    str | None,
    typer.Option(
        "--unit",
        metavar="|".join(METERS),
        help="Of the mesh's coordinates: it gets its true size, and a mesh by itself true gravity.",
    ),
]
Device = Annotated[str | None, typer.Option(help="cpu, cuda:0, ...; the GPU if there is one.")]
Schedule = Annotated[str, typer.Option(help="How the work is laid out: auto, scatter, gather, block, lanes or octets.")]


def scene_changes(overrides: list[str] | None, weld: bool = False, unit: str | None = None) -> list[Override]:
    """What `--set`, `--weld` and `--unit` change in a scene.

    Raises:
        InputError: one is not of the form that it has, or there is no such unit.
    """
    if unit not in (None, *METERS):
        raise InputError(f"--unit {unit}: expected {', '.join(METERS)}")
    units = [] if unit is None else [("balloon.unit", unit)]
    return [*map(parse_override, overrides or []), *([WELD] if weld else []), *units]


def first_line(source: str, scene: Scene) -> str | None:
    """The first line about a mesh by itself: what scene it got."""
    return None if source in bundled_scenes() or Path(source).suffix.lower() == ".toml" else scene.description

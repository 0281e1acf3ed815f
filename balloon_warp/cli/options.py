"""What several commands take, said once."""

from typing import Annotated

import typer

from balloon_warp.scene.overrides import Override, parse_override

WELD: Override = ("balloon.weld", True)
"""what --weld stands for"""

SceneName = Annotated[str, typer.Argument(help="A bundled scene (see `balloon-warp scenes`), a scene file, or a mesh.")]
Weld = Annotated[
    bool,
    typer.Option(
        "--weld",
        help="Join faces wherever vertices lie at exactly the same place, not along open seams alone: "
        "--set balloon.weld=true",
    ),
]
Device = Annotated[str | None, typer.Option(help="cpu, cuda:0, ...; the GPU if there is one.")]
Schedule = Annotated[str, typer.Option(help="How the work is laid out: auto, scatter, gather, block, lanes or octets.")]


def scene_changes(overrides: list[str] | None, weld: bool = False) -> list[Override]:
    """What `--set` and `--weld` change in a scene."""
    return [*map(parse_override, overrides or []), *([WELD] if weld else [])]

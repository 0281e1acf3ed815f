"""The command `balloon-warp kernel`."""

from typing import Annotated

import typer

from balloon_warp.cli.options import Changes, MeshOptions, Set
from balloon_warp.warp_logging import quiet_warp


def kernel(
    scene: Annotated[str, typer.Argument(metavar="SCENE", help="A bundled scene, a scene file, or a mesh.")],
    overrides: Set = None,
    *,
    mesh: MeshOptions,
    schedule: Annotated[
        str,
        typer.Option(metavar="NAME", help="Schedule: gather, scatter, block, lanes or octets."),
    ] = "gather",
) -> None:
    """Print the source of a scene's kernels: the substep in readable form.

    Try `balloon-warp kernel squirrel_tether`.
    """
    loaded = Changes(overrides, mesh).load(scene)
    quiet_warp()
    from balloon_warp.schedules.source import kernel_source  # loads Warp: only once the scene is known to be good

    print(kernel_source(loaded, schedule), end="")

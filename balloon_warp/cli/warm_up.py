"""The command `balloon-warp warm-up`."""

from typing import Annotated

import typer

from balloon_warp.cli.options import Device, Schedule
from balloon_warp.cli.progress import Console
from balloon_warp.scene import bundled_scenes, load_scene
from balloon_warp.scene.load import scene_name
from balloon_warp.warp_logging import quiet_warp


def warm_up(
    scenes: Annotated[
        list[str] | None,
        typer.Argument(metavar="SCENE", help="Bundled scenes, scene files or meshes. All bundled scenes if not given."),
    ] = None,
    worlds: Annotated[int, typer.Option(metavar="COUNT", help="Approximate number of worlds of a later batch.")] = 1,
    device: Device = None,
    schedule: Schedule = "auto",
) -> None:
    """Compile the kernels of scenes ahead of time, so that a later command starts at once.

    Try `balloon-warp warm-up squirrel_tether`. WARP_CACHE_PATH sets the folder of kernels, such as in an image.
    """
    loaded = {scene: load_scene(scene) for scene in scenes or bundled_scenes()}
    quiet_warp()
    from balloon_warp import warming  # loads Warp and USD: only once the scenes are known to be good

    console = Console(emoji=False, highlight=False, soft_wrap=True)
    for source, scene in loaded.items():
        done = warming.warm_up(scene, device, worlds, schedule)
        console.print(
            f"{scene_name(source)}: ready in {done.seconds:.1f} s on {done.device}, schedule {done.schedule}",
            markup=False,
        )

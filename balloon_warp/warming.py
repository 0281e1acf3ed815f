"""Kernels compiled ahead, so that later simulations begin at once."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

from balloon_warp.arguments import checked
from balloon_warp.files import scratch_folder
from balloon_warp.kernels.laws import Law
from balloon_warp.outputs.wanted import animate
from balloon_warp.scene import SceneLike, scene_of
from balloon_warp.sweep.batch import run_batch


@dataclass(frozen=True)
class WarmUp:
    """Result of compiling kernels ahead."""

    device: str
    schedule: str
    seconds: float
    """Duration including compilation [s]; a second time, all but the compilation remains"""


@checked
def warm_up(
    scene: SceneLike,
    device: str | None = None,
    world_count: int = 1,
    schedule: str = "auto",
    laws: Sequence[Law] = (),
) -> WarmUp:
    """Compile the kernels that a scene needs, so that later runs begin at once.

    It simulates one frame as `animate` or `run_batch` does, with a picture, and throws it away. Warp keeps the kernels
    in its cache, where later processes of this machine find them. The environment variable WARP_CACHE_PATH says where.

    Which kernels a scene needs depends on its methods, not on its meshes or numbers. A method that a `[[change]]`
    brings is compiled when the change comes.

    Args:
        scene: Scene, or a source that `load_scene` takes.
        device: Warp device; the GPU, or else the CPU, if not given.
        world_count: more than one for a batch of about as many: with "auto" the schedule depends on it.
        schedule: Parallel schedule: "scatter", "gather", "block", "lanes", "octets", or "auto" for the fastest.
        laws: User-defined laws beside the built-in ones.

    Raises:
        InputError: as `animate` and `run_batch`.
    """
    began = time.perf_counter()
    short = scene_of(scene).model_copy(update={"frames": 1, "picture_frame": None})
    with scratch_folder() as path:
        how = {"device": device, "schedule": schedule, "laws": laws}
        if world_count == 1:
            done = animate(short, path / "warm.usdc", picture=path / "warm.png", **how)
        else:
            done = run_batch(short, path, world_count, export=[0], **how)
    return WarmUp(done.device, done.schedule, time.perf_counter() - began)

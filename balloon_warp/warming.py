"""Kernels compiled ahead, so that what is simulated later begins at once."""

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from balloon_warp.job import animate
from balloon_warp.kernels.laws import Law
from balloon_warp.scene import SceneLike, scene_of
from balloon_warp.sweep.batch import run_batch


@dataclass(frozen=True)
class WarmUp:
    """What was compiled."""

    device: str
    schedule: str
    seconds: float
    """that it took, with what had to be compiled: a second time it is what is left"""


def warm_up(
    scene: SceneLike,
    device: str | None = None,
    world_count: int = 1,
    schedule: str = "auto",
    laws: Sequence[Law] = (),
) -> WarmUp:
    """Simulate one frame of a scene as `animate` does, with a picture, or as `run_batch` does, and throw it away. Warp
    keeps the kernels that are compiled for it in its cache, where later processes of this machine find them;
    WARP_CACHE_PATH is where that is.

    A scene needs kernels of its own for the methods that it has, not for its meshes or numbers. Those of a method that
    a `[[change]]` brings are compiled when it comes.

    Args:
        scene: a scene, or what `load_scene` makes one of.
        device: a Warp device; the GPU where there is one, when missing.
        world_count: more than one for a batch of about as many: with "auto" the schedule depends on it.
        schedule: "scatter", "gather", "block", "lanes", "octets", or "auto" for the fastest.
        laws: that act beside the built-in ones.

    Raises:
        InputError: as `animate` and `run_batch`.
    """
    began = time.perf_counter()
    short = scene_of(scene).model_copy(update={"frames": 1, "picture_frame": None})
    with tempfile.TemporaryDirectory(prefix="balloon-warp-") as folder:
        path, how = Path(folder), {"device": device, "schedule": schedule, "laws": laws}
        if world_count == 1:
            done = animate(short, path / "warm.usdc", picture=path / "warm.png", **how)
        else:
            done = run_batch(short, path, world_count, export=[0], **how)
    return WarmUp(done.device, done.schedule, time.perf_counter() - began)

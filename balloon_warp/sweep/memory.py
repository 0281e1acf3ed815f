"""What a batch takes besides its models, and whether all fits, before anything is allocated."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from balloon_warp.device import pick_device
from balloon_warp.model import Model, world_bytes
from balloon_warp.model.memory import require_memory
from balloon_warp.scene import Scene
from balloon_warp.solvers.choose import solver_named
from balloon_warp.sweep.groups import Group
from balloon_warp.sweep.recorder import MEASURES, picked_bytes, record_bytes


def require_batch_memory(
    models: Sequence[Model],
    schedules: Sequence[str],
    groups: Sequence[Group],
    chosen: NDArray[np.integer],
    scene: Scene,
    frames_held: int,
) -> None:
    """Make sure that all worlds fit on the device, and the table and some frames of the chosen worlds on the host.

    Args:
        models: of the groups, all on one device.
        schedules: the name of each one's.
        frames_held: frames of the chosen worlds that are in the host's memory at a time.

    Raises:
        InputError: they do not, and the message says how many worlds would; or there is no such schedule.
    """
    counts = [len(group.worlds) for group in groups]
    on_device, on_host = [], []
    for model, schedule, group in zip(models, schedules, groups, strict=True):
        picked = picked_bytes(group.plan) * len(group.rows_of(chosen)) // len(group.worlds)
        simulated = world_bytes(model) + solver_named(schedule, model).world_bytes(model)
        on_device.append(simulated + record_bytes(group.plan) + picked)
        on_host.append(table_bytes(scene) + frames_held * picked)
    device = models[0].device
    if device.is_cpu:
        on_host = [sum(both) for both in zip(on_device, on_host, strict=True)]
    else:
        require_memory(device, counts, on_device)
    require_memory(pick_device("cpu"), counts, on_host)


def table_bytes(scene: Scene) -> int:
    """Host memory of a world's rows of the table: its measures and its health in every frame."""
    return 4 * (scene.frames + 1) * (len(MEASURES) + len(scene.sphere) + 1)

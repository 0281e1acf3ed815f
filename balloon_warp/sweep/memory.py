"""Memory of a batch besides its models, checked before anything is allocated."""

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from balloon_warp.device import pick_device
from balloon_warp.kernels.laws import Law
from balloon_warp.model import Model, lay_out, plan_model, world_bytes
from balloon_warp.model.memory import require_memory
from balloon_warp.model.shape import shape_balloon
from balloon_warp.model.vary import SHAPING
from balloon_warp.scene import Scene
from balloon_warp.solvers.choose import settled_solver, solver_named
from balloon_warp.sweep.groups import Group
from balloon_warp.sweep.recorder import columns_of, contact_bytes, picked_bytes, record_bytes
from balloon_warp.sweep.world_files.tracks import bytes_of_frame

MANY = 50_000
"""Number of worlds whose values take longer to make than the size of one world takes to find"""
SOME = 64
"""Number of worlds at which one takes no more memory than with many: schedules lay out several side by side"""


def require_room(
    scene: Scene,
    world_count: int,
    varied: Collection[str] = (),
    device: str | None = None,
    schedule: str = "auto",
    laws: Sequence[Law] = (),
    spread: bool = False,
) -> None:
    """Make sure that so many worlds could fit, before each gets its values.

    That is where they are very many, and all of one size.

    Args:
        varied: the paths of values that differ.
        device: Warp device; the GPU, or else the CPU, if not given.
        spread: whether workers simulate them, and only the table is here.

    Raises:
        InputError: they could not, or the scene cannot be simulated, or there is no such device or schedule.
    """
    if world_count < MANY or any(map(SHAPING.fullmatch, varied)):
        return
    on_host = table_bytes(scene)
    if not spread:
        shapes = [shape_balloon(balloon, scene, as_soft_as_can_be=True) for balloon in scene.balloon]
        model = lay_out(plan_model(scene, SOME, shapes=shapes, laws=laws), pick_device(device))
        solver = solver_named(settled_solver(schedule, model, world_count), model)
        simulated = world_bytes(model) + solver.world_bytes(model)
        require_memory(model.device, [world_count], [simulated])
        on_host += simulated if model.device.is_cpu else 0
    require_memory(pick_device("cpu"), [world_count], [on_host])


def require_batch_memory(
    models: Sequence[Model],
    schedules: Sequence[str],
    groups: Sequence[Group],
    chosen: NDArray[np.integer],
    scene: Scene,
    frames_held: int,
    every: int = 0,
) -> None:
    """Make sure that all worlds fit on the device, and the table and some frames of the chosen worlds on the host.

    Args:
        models: of the groups, all on one device.
        schedules: the name of each one's.
        frames_held: frames of the chosen worlds that are in the host's memory at a time.
        every: step between frames that go into files of worlds, and are held likewise; 0 for none.

    Raises:
        InputError: they do not, and the message says how many worlds would; or there is no such schedule.
    """
    counts = [len(group.worlds) for group in groups]
    on_device, on_host = [], []
    for model, schedule, group in zip(models, schedules, groups, strict=True):
        picked = picked_bytes(group.plan) * len(group.rows_of(chosen)) // len(group.worlds)
        simulated = world_bytes(model) + solver_named(schedule, model).world_bytes(model)
        on_device.append(simulated + record_bytes(group.plan) + picked)
        tracked = bytes_of_frame(group.plan) * -(-frames_held // every) if every else 0
        on_host.append(table_bytes(scene) + contact_bytes(group.plan) + frames_held * picked + tracked)
    device = models[0].device
    if device.is_cpu:
        on_host = [sum(both) for both in zip(on_device, on_host, strict=True)]
    else:
        require_memory(device, counts, on_device)
    require_memory(pick_device("cpu"), counts, on_host)


def table_bytes(scene: Scene) -> int:
    """Return the host memory of a world's rows of the table: its measures and its health in every frame."""
    return 4 * (scene.frames + 1) * (len(columns_of(scene)) + 1)

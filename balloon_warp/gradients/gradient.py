"""Derivatives of a loss by values of a scene: what must change so that it ends there."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.device import pick_device
from balloon_warp.errors import InputError
from balloon_warp.gradients.bars import by_keyframes, by_numbers, by_start, columns_of_names
from balloon_warp.gradients.chain import Chain, chains_of, names_in, product
from balloon_warp.gradients.loss import Loss, Told, told_by
from balloon_warp.gradients.refusals import require_differentiable, require_paths
from balloon_warp.kernels.laws import Law
from balloon_warp.model import Model, ModelPlan, Vary, lay_out
from balloon_warp.model.memory import require_memory
from balloon_warp.model.varied_scene import scene_to_vary
from balloon_warp.scene import SceneLike
from balloon_warp.scene.overrides import Override
from balloon_warp.schedules.backward import BackwardFrames, bytes_of_world
from balloon_warp.shown import Shown, described
from balloon_warp.simulator import Simulator
from balloon_warp.sweep.groups import plan_groups
from balloon_warp.trajectories import Trajectories, by_balloon, empty_tracks, record
from balloon_warp.warp_lock import lock_of

Values = NDArray[np.float64]


@described
@dataclass(frozen=True, repr=False)
class Gradient(Shown):
    """A loss, and how it grows with values of a scene."""

    loss: Values
    """Loss of each world, shape (world_count,)"""
    gradients: dict[str, Values]
    """Derivatives of each world's loss by its own value, by paths, shape (world_count,)"""
    trajectories: Trajectories
    """How everything moved, as the loss has seen it"""

    def __repr__(self) -> str:
        return f"Gradient({len(self.loss)} worlds, of {', '.join(self.gradients)})"


def gradient(
    scene: SceneLike,
    overrides: Mapping[str, Any] | Iterable[Override] = (),
    *,
    of: Sequence[str],
    loss: Loss,
    world_count: int = 1,
    vary: Vary | None = None,
    device: str | None = None,
    laws: Sequence[Law] = (),
    on_frame: Callable[[int], None] = lambda number: None,
) -> Gradient:
    """Simulate a scene, and derive a loss by values of the scene.

    The frames are those of `simulate(..., schedule="gather")`, to the bit. Then they run backwards, from the last.

    Args:
        scene: a scene, the name of a bundled one, a scene file, or a mesh, as a file or in memory.
        overrides: dotted paths and values, as in `load_scene`.
        of: dotted paths of the values to derive by: "balloon.stiffness.structural", "balloon.inflation.amount".
        loss: a function of the `Trajectories`. It returns a number for each world, and its derivatives by what it used
            of them: {"points": [...]}, an array for each balloon, as `velocities`; or {"volumes": ...}, as `pressures`.
        world_count: how many copies of the scene, side by side.
        vary: what differs between the worlds: dotted paths, and a value for each world.
        device: a Warp device; if missing, the GPU or else the CPU.
        laws: your own, which act beside the built-in ones; Warp derives them.
        on_frame: called with the number of each frame when it is simulated, and again when it has run backwards.

    Raises:
        InputError: the scene cannot be simulated, or not be derived, or a path not; or the loss is no number a world.
        BlowUpError: a world blew up.
    """
    vary = vary or {}
    groups = plan_groups(scene_to_vary(scene, vary, overrides), world_count, vary, laws)
    if len(groups) > 1:
        raise InputError("vary: gradients are of one mesh and its springs; expected values that make no other model")
    plan = groups[0].plan
    require_differentiable(plan)
    chains = chains_of(plan, of, vary)
    model = lay_out(plan, pick_device(device))
    require_paths(plan, model, chains)
    columns = columns_of_names(model.columns, names_in(chains))
    frames = plan.scene.frames
    with lock_of(model.device):
        require_memory(model.device, [world_count], [bytes_of_world(model, columns, frames)])
        simulator = Simulator.of_model(model, "gather")
        backward = BackwardFrames(model, simulator.state, columns)
    tracks, checkpoints = empty_tracks(groups, world_count, frames + 1), []
    for number in range(frames + 1):
        if number:
            with lock_of(model.device):
                checkpoints.append(backward.checkpoint(simulator.state))
            simulator.step_unread()
        record(tracks, simulator, groups[0], number)
        on_frame(number)
    meshes = [shape.mesh for shape in plan.shapes]
    times = np.arange(frames + 1) / plan.scene.frames_per_second
    moved = Trajectories(plan.scene, meshes, times, **by_balloon(tracks, meshes))
    told = told_by(loss, moved, plan.shapes, world_count)
    bars = _run_backwards(plan, model, backward, checkpoints, told, on_frame)
    gradients = {chain.path: _by_path(chain, bars, world_count) for chain in chains}
    if told.depends:
        _require_effect(gradients, told)
    return Gradient(told.loss, gradients, moved)


def _run_backwards(
    plan: ModelPlan,
    model: Model,
    backward: BackwardFrames,
    checkpoints: list[Any],
    told: Told,
    on_frame: Callable[[int], None],
) -> dict[str, Values]:
    """Return derivatives by all parameters of the model, worlds first."""
    keyed = np.zeros((model.world_count, *model.keyframe_times.shape))
    given = not any(kind == "gas" for kind in (balloon.inflation.kind for balloon in plan.scene.balloon))
    for number in range(len(checkpoints), 0, -1):
        with lock_of(model.device):
            pressures = told.pressures[:, number]
            backward.add(told.points[:, number], told.velocities[:, number], 0.0 * pressures if given else pressures)
            backward.turn_back(checkpoints.pop())
            sums = np.asarray(backward.bars.keyed_totals.numpy(), dtype=np.float64).copy()
        if given:  # as a frame ends, the pressure of its last substep is noted
            sums[..., 0] += pressures
            sums[..., 1] += pressures * (model.substeps - 1) * model.step_seconds
        keyed += by_keyframes(model, number - 1, sums)
        on_frame(number)
    backward.add(told.points[:, 0], told.velocities[:, 0], told.pressures[:, 0])
    at_start = backward.by_state()
    totals = np.asarray(backward.bars.number_totals.numpy(), dtype=np.float64)
    gas = np.asarray(backward.bars.gas_totals.numpy(), dtype=np.float64)
    return {
        **by_numbers(model.columns, backward.columns, totals),
        **by_start(plan, model, at_start["points"], at_start["velocities"]),
        "initial_gas_amounts": gas[..., 0], "initial_free_volumes": gas[..., 1], "keyframe_values": keyed,
        "initial_pressures": at_start["pressures"], "initial_loads": at_start["loads"],
    }  # fmt: skip


def _by_path(chain: Chain, bars: Mapping[str, Values], world_count: int) -> Values:
    """Return the derivative by the value at a path in each world."""
    total = np.zeros(world_count)
    for name, slopes in chain.slopes.items():
        if name in bars:
            total += product(slopes, bars[name])
    return total


def _require_effect(gradients: Mapping[str, Values], told: Told) -> None:
    """Make sure that each value has an effect on the loss.

    Raises:
        InputError: one has none, in any world.
    """
    for path, values in gradients.items():
        if not values.any():
            raise InputError(
                f"{path}: no path leads from it to the loss: what the loss looks at does not depend on it, or its law "
                "is left out at the value that it has"
            )

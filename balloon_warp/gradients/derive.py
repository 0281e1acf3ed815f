"""A loss of a planned model, and its derivatives: frames forward, and then backward."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.device import pick_device
from balloon_warp.gradients.bars import columns_of_names
from balloon_warp.gradients.by_launches import bytes_by_launches, made_backward, schedule_for, wanted_of
from balloon_warp.gradients.chain import Chain, chains_of, names_in, product
from balloon_warp.gradients.each import by_each
from balloon_warp.gradients.loss import Loss, told_by
from balloon_warp.gradients.refusals import bytes_of_tracks, require_paths
from balloon_warp.gradients.replay import beginnings_in_tracks, beginnings_on_host, checkpoints_that_fit
from balloon_warp.gradients.spans import KeptParameters
from balloon_warp.gradients.way_back import WayBack
from balloon_warp.kernels.laws import Law
from balloon_warp.model import Model, Vary, lay_out
from balloon_warp.model.memory import require_memory
from balloon_warp.schedules.choose_backward import backwards_of, bytes_backwards, forward_of
from balloon_warp.shown import Shown, described
from balloon_warp.simulator import Simulator
from balloon_warp.sweep.groups import Group
from balloon_warp.trajectories import Trajectories, by_balloon, empty_tracks, record
from balloon_warp.warp_lock import lock_of

Values = NDArray[np.float64]


@described
@dataclass(frozen=True, repr=False)
class Gradient(Shown):
    """Loss of a simulation, and its derivatives by values of the scene."""

    loss: Values
    """Loss of each world, shape (world_count,)"""
    gradients: dict[str, Values]
    """Derivatives of each world's loss by its own value, by paths, shape (world_count,)"""
    trajectories: Trajectories
    """Trajectories, as the loss has seen them"""
    by_points: list[Values]
    """Derivatives by where each particle starts, with the amounts of gas as they are: of each balloon an array as of a
    frame of the trajectories, shape (world_count, n, 3), without the first for a single world"""
    by_velocities: list[Values]
    """Derivatives by how fast each particle starts"""
    by_each: dict[str, list[Values]] = field(default_factory=dict)
    """Derivatives that `each` asks for, by its names: of each balloon an array, as in `by_points`. By `rest_lengths`
    and `spring_constants`, shape (world_count, spring_count), in the order of `spring_pairs`; by `thicknesses`, shape
    (world_count, face_count); by `rest_points`, shape (world_count, n, 3)"""
    spring_pairs: list[NDArray[np.int32]] = field(default_factory=list)
    """Particles at the ends of each spring, of each balloon, shape (spring_count, 2)"""
    errors: dict[str, Values] = field(default_factory=dict)
    """Standard errors of `gradients`, which with `smooth` are means over samples, by paths, shape (world_count,)"""
    slopes: dict[str, Values] = field(default_factory=dict)
    """Slopes of the loss over the samples of `smooth`, by its paths (least squares), shape (world_count,): they count
    jumps of the loss, which no gradient sees"""

    def __repr__(self) -> str:
        return f"Gradient({len(self.loss)} worlds, of {', '.join([*self.gradients, *self.by_each])})"


class Asked(NamedTuple):
    """Hold the derivatives that are asked of a scene, see `gradient`."""

    of: Sequence[str]
    loss: Loss
    world_count: int
    vary: Vary
    device: str | None
    schedule: str
    laws: Sequence[Law]
    each: Sequence[str] = ()
    every: int = 1
    checkpoints: int | None = None


def derive(group: Group, asked: Asked, on_frame: Callable[[int], None] = lambda number: None) -> tuple[Gradient, bool]:
    """Return a gradient, even if it is zero, and whether the loss depends on anything that moves.

    Args:
        group: Worlds, with their plan.
        asked: arguments of `gradient` for them.
        on_frame: as in `gradient`.

    Raises:
        InputError: as `gradient`, but for values without an effect.
        BlowUpError: a world blew up.
    """
    of, loss, world_count, vary, device, schedule, _, each, every, checkpoints = asked
    plan = group.plan
    chains = chains_of(plan, of, vary) if of or not each else []
    wanted = wanted_of(plan, chains, each)
    schedule = schedule_for(wanted, schedule)
    model = lay_out(plan, pick_device(device))
    require_paths(plan, model, chains)
    columns = columns_of_names(model.columns, names_in(chains))
    frames, in_tracks = plan.scene.frames, every == 1 and checkpoints is None
    with lock_of(model.device):
        needed = bytes_backwards(model, columns, frames if in_tracks else 1, schedule)
        require_memory(model.device, [world_count], [needed + bytes_by_launches(model, wanted)])
        runs_back = backwards_of(model, schedule)
        simulator = Simulator.of_model(model, forward_of(model, runs_back))
        model = simulator.model  # of parameters of its own, where they change
        backward, beside = made_backward(plan, model, simulator.state, runs_back, columns, wanted)
    room = dict(model.contact_room)
    tracks, first = empty_tracks([group], world_count, frames // every + 1), int(group.worlds[0])
    parameters = KeptParameters(plan, model)
    if in_tracks:
        beginnings = beginnings_in_tracks(simulator, backward, tracks)
    else:
        most = checkpoints or checkpoints_that_fit(simulator, backward, frames, bytes_of_tracks(plan, every))
        beginnings = beginnings_on_host(simulator, backward, parameters, frames, most)
    for number in range(frames + 1):
        if number:
            beginnings.note(number - 1)
            simulator.step_unread()
            parameters.note(number - 1)
        if number % every == 0:
            record(tracks, simulator, group, number // every, first)
        on_frame(number)
    if model.contact_room != room:  # lists of contacts have grown on the way
        with lock_of(model.device):
            backward, beside = made_backward(plan, model, simulator.state, runs_back, columns, wanted)
    meshes = [shape.mesh for shape in plan.shapes]
    times = np.arange(0, frames + 1, every) / plan.scene.frames_per_second
    moved = Trajectories(plan.scene, meshes, times, **by_balloon(tracks, meshes), worlds=group.worlds)
    told = told_by(loss, moved, plan.shapes, world_count)
    bars = WayBack(plan, model, backward, parameters, beginnings, every, beside).back(told, on_frame)
    gradients = {chain.path: _by_path(chain, bars, world_count) for chain in chains}
    by_points, by_velocities = (_by_balloon(bars[0][f"particle_{name}"], model) for name in ("points", "velocities"))
    of_each = by_each(plan, model, beside.of_each(), each) if each else {}
    of_each = {name: _alone(parts) for name, parts in of_each.items()}
    pairs = [shape.springs.pairs for shape in plan.shapes]
    return Gradient(told.loss, gradients, moved, by_points, by_velocities, of_each, pairs), told.depends


def _by_balloon(array: Values, model: Model) -> list[Values]:
    """Return the particles of each balloon, as trajectories have them."""
    offsets = model.particle_offsets
    return _alone([array[:, begin:end] for begin, end in pairwise(offsets)])


def _alone(parts: list[Values]) -> list[Values]:
    """Return arrays without the dimension for worlds, if there is only one."""
    return [part[0] for part in parts] if len(parts[0]) == 1 else parts


def _by_path(chain: Chain, bars: Sequence[Mapping[str, Values]], world_count: int) -> Values:
    """Return the derivative by the value at a path in each world."""
    total = np.zeros(world_count)
    for span, of_span in zip(chain.spans, bars, strict=True):
        for name, slopes in span.items():
            if name in of_span:
                total += product(slopes, of_span[name])
    return total

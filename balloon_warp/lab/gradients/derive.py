"""A loss of a planned model, and its derivatives: frames forward, kept beginnings, and the way back.

Checkpoints of frames for the backward pass: of all, or of few, from which others are recomputed.

Few are kept by the binomial schedule (Griewank and Walther, "Algorithm 799: Revolve", 2000): no other computes fewer
frames again. With c of them and frames computed again at most r times, binomial(c + r, c) frames can run back.

Checkpoints of a simulation's frames, from the trajectories and the device, or on the host by themselves.

Places and velocities with which a frame begins are those of the trajectories, where these have all frames. They stay on
the host. So a device keeps little of each frame, and there may be many. Where trajectories have fewer, or few are asked
for, the start states of some are kept on the host, and others are simulated again from there.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import comb
from typing import Any, NamedTuple, Protocol

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.batch.recorder import Group
from balloon_warp.batch.trajectories import Trajectories, by_balloon, empty_tracks, record
from balloon_warp.errors import InputError
from balloon_warp.kernels.adjoints.spheres import COLUMNS as OF_SPHERES
from balloon_warp.kernels.adjoints.spheres import EVENTS_OF_A_SPHERE
from balloon_warp.kernels.laws import Law
from balloon_warp.kernels.laws.membrane import SOFTENING_PARAMETERS, TEARING_PARAMETERS
from balloon_warp.lab.gradients.chain import (
    KEYFRAMES,
    ON_GROUND,
    ByLaunches,
    Chain,
    KeptParameters,
    by_each,
    by_keyframes,
    by_start,
    bytes_by_launches,
    chains_of,
    columns_of_names,
    made_backward,
    names_in,
    product,
    schedule_for,
    taken_numbers,
    wanted_of,
)
from balloon_warp.lab.gradients.losses import Loss, of_kernel
from balloon_warp.lab.statics import Volume
from balloon_warp.mesh.topology import inconsistent_edges, is_closed, mesh_edges
from balloon_warp.model import Model, ModelPlan, Vary, lay_out
from balloon_warp.model.obstacles import FRICTION, SAID
from balloon_warp.model.parameters import METHODS
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.state import require_memory, usable_memory
from balloon_warp.model.touch import STIFFNESSES
from balloon_warp.schedules.backward import ANCHOR, CONDUCTANCE, OF_STRINGS, POSITION, BackwardFrames
from balloon_warp.schedules.backward_contact import OF_OBSTACLES as RESTITUTION
from balloon_warp.schedules.backward_launched import (
    backwards_of,
    bytes_backwards,
    forward_of,
    gradient_step,
    kernels_of,
)
from balloon_warp.schedules.tables import model_features
from balloon_warp.schedules.touch_table import round_ridges
from balloon_warp.simulator import Simulator
from balloon_warp.system.api import Shown, described
from balloon_warp.system.warp_threads import lock_of, pick_device

KNOWN = ("points", "velocities", "volumes", "pressures", "sphere_positions", "sphere_velocities")


class LossDerivatives(NamedTuple):
    """Loss and its derivatives, worlds first."""

    loss: NDArray[np.float64]
    points: NDArray[np.float64]
    """Shape (world_count, frame_count, particle_count, 3)"""
    velocities: NDArray[np.float64]
    pressures: NDArray[np.float64]
    """Shape (world_count, frame_count, balloon_count)"""
    sphere_positions: NDArray[np.float64]
    """Shape (world_count, frame_count, sphere_count, 3)"""
    sphere_velocities: NDArray[np.float64]

    @property
    def depends(self) -> bool:
        """Return whether the loss depends on anything."""
        return any(array.any() for array in self[1:])


def evaluate_loss(loss: Loss, moved: Trajectories, shapes: Sequence[BalloonShape], world_count: int) -> LossDerivatives:
    """Evaluate a loss.

    Raises:
        InputError: its result is not a number for each world, and a dictionary of derivatives.
    """
    told = (of_kernel(loss) if isinstance(loss, wp.Kernel) else loss)(moved)
    if not (isinstance(told, tuple) and len(told) == 2 and isinstance(told[1], Mapping)):
        raise InputError(
            "loss: expected two things, a number for each world and a dictionary of derivatives such as "
            f'{{"points": [...]}} (got {type(told).__name__})'
        )
    value, slopes = np.asarray(told[0], dtype=np.float64), told[1]
    if value.shape not in ((world_count,), () if world_count == 1 else (world_count,)):
        raise InputError(f"loss: expected a number for each of {world_count} worlds (got shape {value.shape})")
    if not np.isfinite(value).all():
        raise InputError(f"loss: is not finite in world {int(np.argmin(np.isfinite(value.reshape(-1))))}")
    for name in slopes:
        if name not in KNOWN:
            raise InputError(f"loss: has no derivatives by {name}; what it can have is {', '.join(KNOWN)}")
    particles = [_of_balloons(slopes, name, getattr(moved, name)) for name in ("points", "velocities")]
    by_points, by_velocities = (_worlds_first(each, world_count, 4) for each in particles)
    by_volumes, by_pressures, *by_spheres = (
        _worlds_first(_one(slopes, name, getattr(moved, name).shape), world_count, dimensions)
        if name in slopes
        else np.zeros((*by_points.shape[:2], *getattr(moved, name).shape[2 - dimensions :]))
        for name, dimensions in (("volumes", 3), ("pressures", 3), ("sphere_positions", 4), ("sphere_velocities", 4))
    )
    _add_volumes(by_points, by_volumes, moved, shapes)
    return LossDerivatives(value.reshape(world_count), by_points, by_velocities, by_pressures, *by_spheres)


def _one(slopes: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return derivatives as numbers of a shape."""
    try:
        array = np.asarray(slopes[name], dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"loss: its derivatives by {name} must be numbers of shape {shape}") from None
    if array.shape != shape:
        raise InputError(f"loss: its derivatives by {name} must have the shape {shape} (got {array.shape})")
    if not np.isfinite(array).all():
        raise InputError(f"loss: its derivatives by {name} are not finite")
    return array


def _of_balloons(slopes: Mapping[str, Any], name: str, tracks: Sequence[NDArray]) -> NDArray[np.float64]:
    """Return derivatives by all particles, of a list by balloon; those of balloons that it lacks are 0."""
    if name not in slopes:
        return np.concatenate([np.zeros(track.shape) for track in tracks], axis=-2)
    given = slopes[name]
    if not isinstance(given, list | tuple) or len(given) > len(tracks):
        raise InputError(f"loss: its derivatives by {name} must be a list of {len(tracks)}, an array for each balloon")
    arrays = [_one({name: each}, name, track.shape) for each, track in zip(given, tracks, strict=False)]
    arrays += [np.zeros(track.shape) for track in tracks[len(arrays) :]]
    return np.concatenate(arrays, axis=-2)


def _worlds_first(array: NDArray[Any], world_count: int, dimensions: int) -> NDArray[Any]:
    return array if array.ndim == dimensions else array.reshape(world_count, *array.shape)


def _add_volumes(
    by_points: NDArray[np.float64],
    by_volumes: NDArray[np.float64],
    moved: Trajectories,
    shapes: Sequence[BalloonShape],
) -> None:
    """Add the contribution of volumes to derivatives by places, through the volumes' slopes."""
    begin = 0
    for number, shape in enumerate(shapes):
        end = begin + shape.mesh.vertex_count
        track = _worlds_first(moved.points[number], len(by_points), 4)
        volume = Volume(shape.mesh)
        for world, frame in zip(*np.nonzero(by_volumes[:, :, number]), strict=True):
            slopes = volume.slopes(track[world, frame].astype(np.float64))
            by_points[world, frame, begin:end] += by_volumes[world, frame, number] * slopes
        begin = end


FOUND = (CONDUCTANCE, RESTITUTION, "keyframe_values", "initial_gas_amounts", "initial_free_volumes")
"""Parameters, besides those of laws and of the start, by which is derived"""
OF_OBSTACLES = (POSITION, KEYFRAMES)
"""Parameters of obstacles by which is derived where particles alone meet these"""
FRICTIONS = (FRICTION, "obstacle_friction", "sphere_friction")
"""Friction of pairs, and the parameters that it follows from"""
RESTITUTIONS = ("sphere_restitution", RESTITUTION)
"""Restitution of spheres, and of obstacles with them"""
BYTES_OF_A_FRAME = 72
"""Memory of the host for a particle: place and velocity, and a loss's derivatives by place, as given and checked"""
UNREAD = frozenset(row.name for row in (*SOFTENING_PARAMETERS, *TEARING_PARAMETERS))
"""Parameters that only phases without an adjoint read, so that they have no effect on derivatives"""


def require_differentiable(plan: ModelPlan) -> None:
    """Make sure that a scene is one that gradients know, as far as the scene tells.

    Raises:
        InputError: names the feature that they do not know.
    """
    scene = plan.scene
    if scene.solver == "projective":
        raise InputError('gradients: `projective` has no adjoint; expected solver = "symplectic_euler"')
    for number, change in enumerate(scene.change):
        for path in change.set:
            if path in METHODS or path.endswith(".gamma"):
                raise InputError(f"gradients: change.{number}.set: {path}: has no adjoint if it changes on the way")


def require_paths(plan: ModelPlan, model: Model, chains: Sequence[Chain]) -> None:
    """Make sure that all phases of a scene run backwards, and lead to the values to derive by.

    Raises:
        InputError: names the phase, or the path.
    """
    features = model_features(model)
    kernels_of(gradient_step(model, features), ())
    if features.measures_areas:
        for shape in plan.shapes:
            edges = mesh_edges(shape.mesh)
            if not is_closed(edges) or len(inconsistent_edges(edges)):
                raise InputError(f"gradients: {shape.name}: a pressure on an open mesh has no adjoint yet")
    laws = {row.name for row in model.columns.rows}
    for chain in chains:
        if not any(chain.spans):
            raise InputError(f"{chain.path}: no path leads from it to the loss: nothing follows from its value")
        for name, slopes in (each for span in chain.spans for each in span.items()):
            known = name in laws or name in (*FOUND, *OF_SPHERES) or name in UNREAD or name.startswith("initial_")
            known = known or (name == FRICTION and _is_of_balloons(plan, slopes)) or name == STIFFNESSES
            known = (
                known
                or (name in OF_STRINGS and not (name == ANCHOR and _carried(plan)))
                or (name in OF_OBSTACLES and _only_particles_meet(plan))
            )
            known = known or (name in FRICTIONS and _frictions_are_known(plan, model))
            known = known and not (name in RESTITUTIONS and plan.scene.body)
            changes = name in (FRICTION, *SAID) and _friction_changes(plan)
            if changes or (name in (*model.parameters, KEYFRAMES) and not known):
                raise InputError(f"{chain.path}: cannot be derived by yet, for it acts by `{name}`")
            if name == "gamma" and (np.asarray(plan.parameters["gamma"]) == 1.0).any():
                raise InputError(f"{chain.path}: cannot be derived by at 1, where the law is another one")
            if not np.isfinite(slopes).all():
                raise InputError(f"{chain.path}: cannot be derived by, its slope is not finite")


def _is_of_balloons(plan: ModelPlan, slopes: NDArray[np.float64]) -> bool:
    """Return whether all coefficients that grow are those of balloons, with each other or the ground."""
    balloons = np.arange(slopes.shape[1])[-len(plan.shapes) :]
    known = [ON_GROUND, *balloons]
    others = slopes.copy()
    others[:, np.array(known)[:, None], known] = 0.0
    return not others.any()


def _only_particles_meet(plan: ModelPlan) -> bool:
    """Return whether particles alone meet obstacles: nothing else that does, or hangs on them, is derived by them."""
    return not (plan.scene.sphere or plan.scene.body or plan.ridges or _carried(plan))


def _carried(plan: ModelPlan) -> bool:
    """Return whether an obstacle carries the anchor of a string."""
    return any(string.obstacle is not None for string in plan.scene.string)


def _frictions_are_known(plan: ModelPlan, model: Model) -> bool:
    """Return whether all that rubs is derived by how it does: not so are bodies, and faces on ridges or as on these."""
    return not (plan.scene.body or plan.ridges or any(round_ridges(model)))


def _friction_changes(plan: ModelPlan) -> bool:
    """Return whether some friction changes on the way."""
    return any(not set(SAID).isdisjoint(change.values) for change in plan.due_changes)


def require_room_for_bounces(worlds: NDArray[np.intp]) -> None:
    """Check that spheres have not met too much.

    Raises:
        InputError: names the first of the worlds in which they have.
    """
    if len(worlds):
        raise InputError(
            f"gradients: the spheres of world {worlds[0]} meet each other, obstacles or the ground more than "
            f"{EVENTS_OF_A_SPHERE} times each in a substep; expected them less crowded"
        )


def bytes_of_tracks(plan: ModelPlan, every: int) -> int:
    """Return the memory of the host for the trajectories that a loss sees, and for its derivatives by them."""
    return BYTES_OF_A_FRAME * plan.particle_count * plan.world_count * (plan.scene.frames // every)


def require_room_for_frames(plan: ModelPlan, every: int, checkpoints: int | None) -> None:
    """Check that the host has room for the trajectories, and for a loss's derivatives by them.

    Raises:
        InputError: it has not; the message says how many frames or worlds it has room for. Or the interval of the
            frames that a loss sees is none, or the number of frames from which others are simulated again.
    """
    frames, worlds = plan.scene.frames, plan.world_count
    if not 1 <= every <= frames:
        raise InputError(f"every: must be a whole number from 1 to {frames}, the frames of the scene (got {every!r})")
    if checkpoints is not None and checkpoints < 1:
        raise InputError(f"checkpoints: must be at least 1 (got {checkpoints!r})")
    needed, usable = bytes_of_tracks(plan, every), usable_memory(pick_device("cpu"))
    if needed > usable:
        seen = frames // every
        raise InputError(
            f"gradients: {seen} frames of {worlds} worlds do not fit: trajectories and derivatives by them need "
            f"{needed / 2**30:.2f} GiB, and the host has {usable / 2**30:.2f} GiB to spare, enough for "
            f"{usable * seen // needed} frames, or {usable * worlds // needed} worlds; expected fewer, or a loss of "
            f"fewer frames, such as every={frames}"
        )


class FrameStarts(Protocol):
    """Checkpoints of frame starts, stored in their order and taken from the last to the first."""

    def note(self, frame: int) -> None:
        """Store the start state of a frame that is about to be simulated."""

    def take(self, frame: int) -> Any:
        """Return the start state of a frame, once."""


class AllFrames:
    """Keep the start state of every frame.

    Args:
        keep: returns a copy of the current state, with which a frame begins.
    """

    def __init__(self, keep: Callable[[int], Any]):
        self._keep = keep
        self._kept: list[Any] = []

    def note(self, frame: int) -> None:
        """Keep the state with which a frame begins."""
        self._kept.append(self._keep(frame))

    def take(self, frame: int) -> Any:
        """Return the start state of the last frame that has not been taken."""
        return self._kept.pop()


class FewFrames:
    """Keep the start states of few frames, and simulate others again from there.

    Args:
        frames: number of all frames.
        most: of those that are kept at a time, at least 1.
        keep: returns a copy of the current state, with which a frame begins.
        go_back: takes such a copy, so that its frame is about to be simulated again.
        advance: simulates a frame again.
    """

    def __init__(
        self, frames: int, most: int, keep: Callable[[int], Any], go_back: Callable[[int, Any], None],
        advance: Callable[[int], None],
    ):  # fmt: skip
        self._most, self._keep, self._go_back, self._advance = most, keep, go_back, advance
        self._kept: list[tuple[int, Any]] = []
        self._first = [0]
        while len(self._first) < most and frames - self._first[-1] > 1:
            self._first.append(
                self._first[-1] + frames_to_next_checkpoint(frames - self._first[-1], most - len(self._first))
            )

    def note(self, frame: int) -> None:
        """Keep the start state of a frame that is a checkpoint."""
        if len(self._kept) < len(self._first) and self._first[len(self._kept)] == frame:
            self._kept.append((frame, self._keep(frame)))

    def take(self, frame: int) -> Any:
        """Return the start state of the last frame that has not been taken."""
        if self._kept[-1][0] == frame:
            return self._kept.pop()[1]
        now = self._kept[-1][0]
        self._go_back(*self._kept[-1])
        while now < frame:
            free = self._most - len(self._kept)
            until = now + frames_to_next_checkpoint(frame + 1 - now, free) if free else frame
            for number in range(now, until):
                self._advance(number)
            now = until
            if free and now < frame:
                self._kept.append((now, self._keep(now)))
        return self._keep(frame)


def min_recomputed_frames(frames: int, free: int) -> int:
    """Least number of frames to simulate so that all run backwards, each recomputed once on the way.

    The first simulation of frames counts, up to the last frame that is kept.

    Args:
        free: number of beginnings that may be kept beside that of the first frame.
    """
    most = free + 1
    times = 0
    while comb(most + times, most) < frames:
        times += 1
    return times * frames - comb(most + times, most + 1)


def frames_to_next_checkpoint(frames: int, free: int) -> int:
    """Frames from one checkpoint to the next, where the first of some frames is one.

    Args:
        free: number of beginnings that may be kept beside the first one, at least 1.
    """

    def cost(way: int) -> int:  # convex
        return way + min_recomputed_frames(frames - way, free - 1) + min_recomputed_frames(way, free)

    low, high = 1, frames - 1
    while low < high:
        middle = (low + high) // 2
        if cost(middle + 1) < cost(middle):
            low = middle + 1
        else:
            high = middle
    return low


IN_TRACKS = ("points", "velocities")
"""Parts of a frame's beginning that the trajectories have"""


def frame_starts_in_tracks(
    simulator: Simulator, backward: BackwardFrames, tracks: Mapping[str, NDArray[Any]]
) -> FrameStarts:
    """Return the start states of all frames, most of which trajectories have."""

    def keep(frame: int) -> dict[str, Any]:
        with lock_of(simulator.model.device):
            little = backward.checkpoint(simulator.state, but=IN_TRACKS)
        return little | {name: tracks[name][:, frame] for name in IN_TRACKS}

    return AllFrames(keep)


def frame_starts_on_host(
    simulator: Simulator, backward: BackwardFrames, parameters: KeptParameters, frames: int, most: int
) -> FrameStarts:
    """Return the start states of some frames, at most so many at a time; the simulator simulates others again."""
    device = simulator.model.device

    def keep(frame: int) -> dict[str, Any]:
        with lock_of(device):
            return {name: array.numpy() for name, array in backward.checkpoint(simulator.state).items()}

    def set_parameters(frame: int) -> None:
        if values := parameters.of_span(parameters.span_of(frame)):
            simulator.set_parameters(values)

    def go_back(frame: int, beginning: Mapping[str, Any]) -> None:
        set_parameters(frame)
        with lock_of(device):
            for name, array in beginning.items():
                getattr(simulator.state, name).assign(array)
        simulator.frame_number = frame

    def advance(frame: int) -> None:
        if parameters.span_of(frame) != parameters.span_of(frame - 1):
            set_parameters(frame)
        simulator.advance()

    return FewFrames(frames, most, keep, go_back, advance)


def checkpoints_that_fit(simulator: Simulator, backward: BackwardFrames, frames: int, taken: int) -> int:
    """Return how many frames' beginnings the host has room for, up to all, and at least 1.

    Args:
        taken: memory of the host that something else wants.
    """
    arrays = [getattr(simulator.state, name) for name in backward.kept_names]
    each = sum(array.size * wp.types.type_size_in_bytes(array.dtype) for array in arrays)
    return int(np.clip((usable_memory(pick_device("cpu")) - taken) // each, 1, frames))


Values = NDArray[np.float64]


class BackwardPass:
    """Run frames backwards.

    Args:
        parameters: in each span.
        frame_starts: start states of frames.
        every: interval of the frames that the loss has seen.
        beside: derivatives that only launches find.
    """

    def __init__(
        self, plan: ModelPlan, backward: BackwardFrames, parameters: KeptParameters, frame_starts: FrameStarts,
        every: int, beside: ByLaunches,
    ):  # fmt: skip
        self._plan, self._model, self._backward = plan, backward.model, backward
        self._parameters, self._frame_starts, self._every, self._beside = parameters, frame_starts, every, beside
        kinds = {balloon.inflation.kind for balloon in plan.scene.balloon}
        self._given = "gas" not in kinds

    def back(self, told: LossDerivatives, on_frame: Callable[[int], None]) -> list[dict[str, Values]]:
        """Return derivatives by all parameters of the model in each span, and by the start in the first, worlds first.

        A span is that between two changes of the scene.
        """
        keyed = np.zeros((self._model.world_count, *self._model.keyframe_times.shape))
        bars: list[dict[str, Values]] = []
        frames = self._plan.scene.frames
        span = self._parameters.span_of(frames - 1)
        for number in range(frames, 0, -1):
            while self._parameters.span_of(number - 1) < span:
                bars.append({**self._numbers(), "keyframe_values": keyed.copy()})
                keyed[...], span = 0.0, span - 1
            keyed += by_keyframes(self._model, number - 1, self._frame_back(told, number))
            on_frame(number)
        bars.append({**self._numbers(), "keyframe_values": keyed})
        bars += [{}] * span  # changes at the very start
        return [bars[-1] | self._by_start(told), *bars[-2::-1]]

    def _numbers(self) -> dict[str, Values]:
        return taken_numbers(self._model, self._backward, self._beside)

    def _frame_back(self, told: LossDerivatives, number: int) -> Values:
        """Turn derivatives by a frame into those by the one before, and return those by keyed values."""
        model, (place, between) = self._model, divmod(number, self._every)
        pressures = 0.0 * told.pressures[:, 0] if between else told.pressures[:, place]
        begin = self._frame_starts.take(number - 1)
        with lock_of(model.device):
            self._parameters.bring_back(self._parameters.span_of(number - 1))
            if not between:
                self._add(told, place, 0.0 * pressures if self._given else pressures)
            self._backward.turn_back(begin)
            self._beside.note(number - 1)
            sums = np.asarray(self._backward.bars.keyed_totals.numpy(), dtype=np.float64).copy()
        if self._given:  # as a frame ends, the pressure of its last substep is noted
            sums[..., 0] += pressures
            sums[..., 1] += pressures * (model.substeps - 1) * model.step_seconds
        return sums

    def _add(self, told: LossDerivatives, place: int, pressures: Values) -> None:
        """Add the derivatives of the loss by a frame itself, by its place among those that it has seen."""
        self._backward.add(told.points[:, place], told.velocities[:, place], pressures)
        if self._backward.spheres:
            self._backward.spheres.add(told.sphere_positions[:, place], told.sphere_velocities[:, place])

    def _by_start(self, told: LossDerivatives) -> dict[str, Values]:
        """Return derivatives by all that counts at the start alone."""
        backward = self._backward
        self._add(told, 0, told.pressures[:, 0])
        of_spheres = {}
        if backward.spheres:
            require_room_for_bounces(backward.spheres.crowded_worlds())
            of_spheres = backward.spheres.by_start()
        at_start = backward.by_state()
        gas = np.asarray(backward.bars.gas_totals.numpy(), dtype=np.float64)
        return {
            **of_spheres,
            **by_start(self._plan, self._model, at_start["points"], at_start["velocities"]),
            "initial_gas_amounts": gas[..., 0], "initial_free_volumes": gas[..., 1],
            "particle_points": at_start["points"], "particle_velocities": at_start["velocities"],
            "initial_pressures": at_start["pressures"], "initial_loads": at_start["loads"],
        }  # fmt: skip


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


class DerivativeRequest(NamedTuple):
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


def derive(
    group: Group, asked: DerivativeRequest, on_frame: Callable[[int], None] = lambda number: None
) -> tuple[Gradient, bool]:
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
        frame_starts = frame_starts_in_tracks(simulator, backward, tracks)
    else:
        most = checkpoints or checkpoints_that_fit(simulator, backward, frames, bytes_of_tracks(plan, every))
        frame_starts = frame_starts_on_host(simulator, backward, parameters, frames, most)
    for number in range(frames + 1):
        if number:
            frame_starts.note(number - 1)
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
    told = evaluate_loss(loss, moved, plan.shapes, world_count)
    bars = BackwardPass(plan, backward, parameters, frame_starts, every, beside).back(told, on_frame)
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

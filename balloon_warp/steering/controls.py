"""Controls: values of each world that somebody writes on the device, and the next frame reads.

Each world has a time of its own: planned changes write controls, on the device, and keyframes and obstacles follow.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Parameter
from balloon_warp.kernels.laws.law import FAR
from balloon_warp.kernels.laws.membrane import NEVER
from balloon_warp.kernels.steering import (
    begin_ages,
    follow_plan,
    let_appear,
    move_obstacles,
    read_control,
    write_control,
)
from balloon_warp.model import Model
from balloon_warp.model.parameters import (
    METHODS,
    VELOCITY,
    Place,
    places_of,
    require_changeable,
    rows_of,
    scene_parameters,
)
from balloon_warp.model.setting import plan_setting
from balloon_warp.model.stability import names_of_the_step
from balloon_warp.scene import Scene
from balloon_warp.scene.load import frame_at, is_there
from balloon_warp.system.api import Shown
from balloon_warp.system.warp_threads import launch


def copy_given(target: wp.array, given: Any, path: str) -> None:
    """Copy values into an array of a device; values on that device already do not pass the host.

    Raises:
        InputError: they have another shape or are no numbers.
    """
    source = _on_device(given) if hasattr(given, "__dlpack__") and not isinstance(given, np.ndarray) else given
    if isinstance(source, wp.array):
        if source.dtype != target.dtype:
            source = wp.array(source.numpy(), dtype=target.dtype, device=target.device)
        _require_shape(tuple(source.shape), target, path)
        wp.copy(target, source)
        return
    try:
        values = np.asarray(source, dtype=wp.dtype_to_numpy(target.dtype))
    except (TypeError, ValueError):
        raise InputError(f"{path}: expected a number for each world (got {str(given)[:60]})") from None
    if values.ndim:
        _require_shape(values.shape, target, path)
    target.assign(np.broadcast_to(values, target.shape))


def _on_device(given: Any) -> Any:
    """Return the same memory as an array of Warp."""
    return (
        given if isinstance(given, wp.array) else wp.from_dlpack(given.detach() if hasattr(given, "detach") else given)
    )


def _require_shape(shape: tuple[int, ...], target: wp.array, path: str) -> None:
    if shape != tuple(target.shape):
        raise InputError(f"{path}: expected a value for each world, of shape {tuple(target.shape)} (got {shape})")


def columns_of(array: wp.array, index: Sequence[int | slice]) -> list[wp.array]:
    """Return the numbers at an index of each world's part of an array, a view of shape (world_count,) for each.

    Args:
        array: of floats or vectors of floats, whose first dimension is the world.
        index: into a world's part, with an axis for vectors; a slice stands for all of its dimension.
    """
    worlds, *shape = _number_shape(array)
    scalar = wp.float64 if array.dtype in (wp.float64, wp.vec3d, wp.mat33d) else wp.float32
    strides = [*array.strides, wp.types.type_size_in_bytes(scalar)][: 1 + len(shape)]
    places = np.arange(int(np.prod(shape, dtype=int))).reshape(shape)[tuple(index)]
    return [_column(array, scalar, worlds, strides, np.unravel_index(place, shape)) for place in np.ravel(places)]


def _number_shape(array: wp.array) -> tuple[int, ...]:
    """Return the shape of an array's numbers: those of vectors are a last dimension."""
    vector = getattr(array.dtype, "_shape_", ())
    return (*array.shape, *vector)


def _column(array: Any, scalar: Any, worlds: int, strides: Sequence[int], place: Sequence[Any]) -> wp.array:
    begin = array.ptr + sum(int(at) * stride for at, stride in zip(place, strides[1:], strict=True))
    view = wp.array(ptr=begin, dtype=scalar, shape=(worlds,), strides=(strides[0],), device=array.device)
    view._ref = array  # the memory stays as long as the view
    return view


def rows_of_words(array: Any) -> wp.array:
    """Return a contiguous array as rows of 32-bit words, or of bytes where they do not fill words."""
    row = array.strides[0]
    dtype = wp.uint32 if row % 4 == 0 else wp.uint8
    size = wp.types.type_size_in_bytes(dtype)
    shape = (array.shape[0], row // size)
    view = wp.array(ptr=array.ptr, dtype=dtype, shape=shape, device=array.device)
    view._ref = array
    return view


def component(array: wp.array, axis: int) -> Any:
    """Return a column of an array of shape (world_count, size), or an array of shape (world_count,) itself."""
    return array if array.ndim == 1 else array[:, axis]


Beyond = Literal["clip", "end"]
MOST_CORNERS = 64
"""Most combinations of bounds for which the step is found"""
SETTLED_BY_HOST = frozenset({"gamma", "sphere_radius", "string_stiffness"})
"""Parameters whose change the host accompanies: a gas keeps its pressure, and things appear and end"""


@dataclass(frozen=True)
class ControlPlan:
    """Target that a control writes."""

    path: str
    places: tuple[tuple[Place, ...], ...]
    """Places of each number of a vector, or of the one number"""
    low: float
    high: float
    beyond: Beyond
    planned: bool = False
    """Whether the scene alone writes it, so that its step suffices already"""

    @property
    def names(self) -> set[str]:
        """Names of the parameters."""
        return {name for each in self.places for name, _ in each}


def plan_control(model: Model, path: str, low: float | None, high: float | None, beyond: Beyond) -> ControlPlan:
    """Find the parameters at a path of the scene, and check that they may be written on the device.

    Raises:
        InputError: there is no such path, its value cannot change or lets others follow, or the bounds are wrong.
    """
    rows = rows_of(model.laws)
    if beyond not in ("clip", "end"):
        raise InputError(f'{path}: beyond must be "clip" or "end" (got {beyond!r})')
    places = _places(model, rows, path)
    row = {row.name: row for row in rows}.get(places[0][0][0])
    least, most = (row.least, row.most) if row else (-FAR, FAR)
    plan = ControlPlan(path, places, _bound(path, "low", low, least), _bound(path, "high", high, most), beyond)
    if plan.low > plan.high:
        raise InputError(f"{path}: low must be at most high (got {plan.low:g} and {plan.high:g})")
    if plan.names & SETTLED_BY_HOST:
        raise InputError(f"{path}: cannot be written on the device; `set` changes it")
    if VELOCITY not in plan.names:
        _require_alone(model, plan)
    _require_bounded(model, plan, low, high)
    return plan


def _places(model: Model, rows: Sequence[Parameter], path: str) -> tuple[tuple[Place, ...], ...]:
    if steered := re.fullmatch(r"obstacle\.(\d+)\.velocity", path):
        if (number := int(steered[1])) >= len(model.obstacles):
            raise InputError(f"{path}: no obstacle {number}; the scene has {len(model.obstacles)}")
        return tuple(((VELOCITY, (number, axis)),) for axis in range(3))
    require_changeable(model.scene, rows, [path])
    places = places_of(model.scene, rows)
    if path in places:
        return (tuple(places[path]),)
    axes = [f"{path}.{axis}" for axis in range(3)]
    if not all(axis in places for axis in axes):
        below = sorted(known for known in places if known.startswith(f"{path}."))
        raise InputError(f"{path}: must be the path of a number or a vector; known are {', '.join(below[:6])}")
    return tuple(tuple(places[axis]) for axis in axes)


def _bound(path: str, name: str, given: float | None, own: float) -> float:
    if given is None:
        return own
    if not isinstance(given, int | float | np.number) or not np.isfinite(given):
        raise InputError(f"{path}: {name} must be a finite number (got {given!r})")
    return float(given)


def _require_bounded(model: Model, plan: ControlPlan, low: float | None, high: float | None) -> None:
    """Make sure that numbers on which the step depends have bounds for which a step is found."""
    if plan.names & {*names_of_the_step(model.scene, model.laws), VELOCITY} and (low is None or high is None):
        raise InputError(f"{plan.path}: the step depends on it; expected bounds, as in open(path, low=..., high=...)")


def _require_alone(model: Model, plan: ControlPlan) -> None:
    """Make sure that no other parameter follows from it."""
    before = current_value(model, plan)
    limits = [max(plan.low, -FAR), min(plan.high, FAR)]
    other = next((each for each in limits if abs(each) < FAR and each != before.flat[0]), None)
    probe = np.full_like(before, before.flat[0] + 1.0 if other is None else other)
    try:
        follows = plan_setting(model, {plan.path: probe}, (), 0).parameters.keys() - plan.names
    except InputError as mistake:
        if "substeps" in str(mistake):
            return  # the bounds are checked together with those of other controls
        raise
    if follows:
        others = ", ".join(sorted(follows))
        raise InputError(
            f"{plan.path}: cannot be written on the device, since {others} follow from it; `set` changes it"
        )


def current_value(model: Model, plan: ControlPlan) -> NDArray[np.float64]:
    """Return the present value at the first place of each number, shape (world_count,) or (world_count, 3)."""
    columns = []
    for (name, index), *_ in plan.places:
        if name not in model.parameters:
            columns.append(np.zeros(model.world_count))
            continue
        numbers = np.asarray(model.parameters[name].numpy(), dtype=np.float64)
        numbers = numbers[(slice(None), *index)]
        numbers = numbers.reshape(len(numbers), -1)[:, 0]
        columns.append(np.broadcast_to(numbers, (model.world_count,)))
    return columns[0].copy() if len(columns) == 1 else np.stack(columns, axis=1)


def with_reach(model: Model, plans: Sequence[ControlPlan]) -> Model:
    """Return a model with a row of parameters for each world, which knows between which bounds controls write.

    Raises:
        InputError: the step that the scene says is too long for some values within the bounds.
    """
    if any(VELOCITY in plan.names for plan in plans):
        model = _steered(model)
    reach: dict[str, tuple[NDArray[np.float32], ...]] = {}
    for plan in plans:
        for name in plan.names:
            own = np.asarray(model.parameters[name].numpy(), dtype=np.float32)[:1]
            reach[name] = (
                *reach.get(name, ()),
                _filled(own, plan, name, plan.low),
                _filled(own, plan, name, plan.high),
            )
    return replace(model.with_rows_of_worlds(), reach=reach, substeps=_substeps(model, plans))


def _steered(model: Model) -> Model:
    """Return a model whose obstacles have velocities of their own, and at least two frames of motion."""
    if VELOCITY in model.parameters:
        return model
    motion = model.obstacle_motion
    if motion.shape[0] == 1:
        motion = wp.array(np.repeat(motion.numpy(), 2, axis=0), dtype=motion.dtype, device=model.device)
    velocities = wp.zeros((model.world_count, len(model.obstacles)), dtype=wp.vec3, device=model.device)
    return replace(model, obstacle_motion=motion, parameters={**model.parameters, VELOCITY: velocities})


def _filled(own: NDArray[np.float32], plan: ControlPlan, name: str, value: float) -> NDArray[np.float32]:
    """Return a row of a parameter with a bound where the control writes."""
    row = own.copy()
    for each in plan.places:
        for at, index in each:
            if at == name:
                row[(slice(None), *index)] = value
    return row


def _substeps(model: Model, plans: Sequence[ControlPlan]) -> int:
    """Return the substeps of a frame that suffice for all bounds together."""
    steps = names_of_the_step(model.scene, model.laws)
    asked = [plan for plan in plans if plan.names & steps and not plan.planned]
    corners = list(product(*((plan.low, plan.high) for plan in asked)))
    if len(corners) > MOST_CORNERS:
        paths = ", ".join(plan.path for plan in asked)
        raise InputError(f"controls: too many of them affect the step at once: {paths}")
    found = [model.substeps]
    for corner in corners if asked else ():
        shapes = {plan.path: current_value(model, plan).shape for plan in asked}
        told: Mapping[str, Any] = {
            plan.path: np.full(shapes[plan.path], value) for plan, value in zip(asked, corner, strict=True)
        }
        found.append(plan_setting(model, told, (), 0).substeps)
    return max(found)


SAVED = "controls"
"""Beginning of the names of saved arrays"""


class Steered(Protocol):
    """A simulator, as controls know it."""

    model: Model

    def go_on_in(self, model: Model) -> None: ...


class Controls(Shown):
    """Device arrays by dotted paths of the scene: `simulator.controls["balloon.inflation.pressure"]`.

    Each has a row a world, shape (world_count,), or (world_count, 3) for a vector, float32. Torch, JAX, Warp and NumPy
    write them; every frame reads them as it begins, within its recorded graph. On the device a value beyond its bounds
    is clipped, or ends its world if that is asked. A value that is not finite ends its world always: the parameter
    stays as it was, and `faults` says so.
    """

    _internal = (
        *("begin_again", "column", "firsts", "follow", "move", "open_planned", "open_saved", "require_sound"),
        *("restore", "saved", "size", "write"),
    )

    def __init__(self, simulator: Steered):
        self._simulator = simulator
        self._plans: list[ControlPlan] = []
        self._values: dict[str, wp.array] = {}
        self._first: dict[str, wp.array] = {}
        self._places: wp.array | None = None
        model = simulator.model
        self.faults = wp.zeros(model.world_count, dtype=wp.int32, device=model.device)
        """Number of the control that ended each world, from 1 in the order of their opening; 0 if none has"""

    def __len__(self) -> int:
        return len(self._plans)

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __contains__(self, path: object) -> bool:
        return path in self._values

    def __getitem__(self, path: str) -> wp.array:
        return self._values[path] if path in self._values else self.open(path)

    def __setitem__(self, path: str, values: Any) -> None:
        copy_given(self[path], values, path)

    def __repr__(self) -> str:
        return f"Controls({', '.join(self._values) or 'none is open'})"

    def open(self, path: str, low: float | None = None, high: float | None = None, beyond: Beyond = "clip") -> wp.array:
        """Open a control, and return its array, which begins with the scene's present value.

        Kernels are made again for laws that may act from now on, and the step for the stiffest values within the
        bounds.

        Args:
            path: to a number or a vector of the scene, as in overrides.
            low: least value; the scene's own bound, when missing.
            high: largest value.
            beyond: "clip" values beyond the bounds, or "end" the world.

        Raises:
            InputError: there is no such path, its value cannot be written on the device, or the bounds are wrong.
        """
        if path in self._values:
            raise InputError(f"{path}: is already open")
        return self._open(plan_control(self._simulator.model, path, low, high, beyond))

    def open_planned(self, path: str, first: NDArray[np.float64], low: float, high: float) -> None:
        """Open a control that the scene's planned changes write.

        Args:
            first: numbers that it has as a world begins.

        Raises:
            InputError: its value cannot be written on the device.
        """
        plan = plan_control(self._simulator.model, path, low, high, "clip")
        self._open(replace(plan, planned=True))
        self._first[path].assign(np.broadcast_to(first if len(first) == 3 else first[0], self._first[path].shape))

    def _open(self, plan: ControlPlan) -> wp.array:
        model, path = self._simulator.model, plan.path
        moved = {VELOCITY, "obstacle_position"}
        if moved <= plan.names.union(*(each.names for each in self._plans)):
            raise InputError(f"{path}: controls move an obstacle either by position or by velocity")
        if taken := next((each for each in self._plans if _meet(each, plan)), None):
            raise InputError(f"{path}: is already written by the control {taken.path}")
        controlled = with_reach(model, [*self._plans, plan])
        self._plans.append(plan)
        self._values[path] = wp.array(current_value(model, plan), dtype=wp.float32, device=model.device)
        self._first[path] = wp.clone(self._values[path])
        if controlled.is_steered and self._places is None:
            self._places = wp.clone(controlled.parameters["obstacle_position"])
        self._simulator.go_on_in(controlled)
        return self._values[path]

    def size(self, path: str) -> int:
        """Return how many numbers of a world an open control has."""
        return int(np.prod(self._values[path].shape[1:], dtype=int))

    def column(self, path: str, axis: int) -> wp.array:
        """Return a number of an open control, shape (world_count,)."""
        return component(self._values[path], axis)

    def firsts(self) -> Iterator[tuple[wp.array, wp.array]]:
        """Yield values that worlds get back as they begin anew, from when a control was opened, and their arrays."""
        if self._places is not None:
            yield self._places, self._simulator.model.parameters["obstacle_position"]
        for path, values in self._values.items():
            yield self._first[path], values

    def begin_again(self) -> None:
        """Go on with the same arrays in a model that has just begun; they have the scene's values."""
        self.faults.zero_()
        if self._plans:
            self._simulator.go_on_in(with_reach(self._simulator.model, self._plans))
            self.follow()

    def follow(self) -> None:
        """Read the parameters, after the host has changed some."""
        model = self._simulator.model
        for plan in self._plans:
            for axis, places in enumerate(plan.places):
                name, index = places[0]
                source = columns_of(model.parameters[name], index)[0]
                values = component(self._values[plan.path], axis)
                launch(read_control, model.world_count, [source], [values], device=model.device)

    def saved(self) -> dict[str, NDArray]:
        """Copy all that is open to the host, as arrays by name."""
        if not self._plans:
            return {}
        told = [(plan.path, plan.low, plan.high, plan.beyond) for plan in self._plans]
        arrays = {f"{SAVED}.{path}": np.array(values.numpy()) for path, values in self._values.items()}
        if self._places is not None:
            arrays[f"{SAVED}_places"] = np.array(self._simulator.model.parameters["obstacle_position"].numpy())
        return {**arrays, f"{SAVED}_faults": np.array(self.faults.numpy()), SAVED: np.array(json.dumps(told))}

    def open_saved(self, saved: Mapping[str, NDArray]) -> None:
        """Open the controls that were open when a simulator was saved, and are not here."""
        for path, low, high, beyond in json.loads(str(saved[SAVED])) if SAVED in saved else ():
            if path not in self._values:
                self.open(path, low if low > -FAR else None, high if high < FAR else None, beyond)

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Restore saved controls, in a simulator that has its state already."""
        if SAVED not in saved:
            return
        for path, values in self._values.items():
            if f"{SAVED}.{path}" in saved:
                values.assign(saved[f"{SAVED}.{path}"])
        if f"{SAVED}_places" in saved:
            self._simulator.model.parameters["obstacle_position"].assign(saved[f"{SAVED}_places"])
        self.write()
        self.faults.assign(saved[f"{SAVED}_faults"])

    def write(self) -> None:
        """Write all controls where the kernels read them, at the beginning of a frame."""
        model = self._simulator.model
        for number, plan in enumerate(self._plans, start=1):
            limits = [number, plan.low, plan.high, int(plan.beyond == "end")]
            for axis, places in enumerate(plan.places):
                values = component(self._values[plan.path], axis)
                for target in (
                    column for name, index in places for column in columns_of(model.parameters[name], index)
                ):
                    launch(
                        write_control,
                        model.world_count,
                        [values, *limits],
                        [target, self.faults],
                        device=model.device,
                    )

    def move(self) -> None:
        """Move obstacles on by the velocities of the frame that ends."""
        model = self._simulator.model
        if model.is_steered:
            positions, velocities = model.parameters["obstacle_position"], model.parameters[VELOCITY]
            inputs = [velocities, model.frame_seconds]
            launch(move_obstacles, positions.shape, inputs, [positions], device=model.device)

    def require_sound(self) -> None:
        """Make sure that no control has ended a world.

        Raises:
            InputError: names the first world, and the control.
        """
        faults = np.asarray(self.faults.numpy()) if self._plans else np.zeros(1)
        if faults.any():
            world = int(np.flatnonzero(faults)[0])
            plan = self._plans[int(faults[world]) - 1]
            value = np.asarray(self._values[plan.path].numpy())[world]
            limits = f" between {plan.low:g} and {plan.high:g}" if plan.beyond == "end" else ""
            raise InputError(f"{plan.path}: must be a finite number{limits}, in world {world} (got {value})")


def _meet(one: ControlPlan, other: ControlPlan) -> bool:
    """Return whether two controls write the same number."""

    def numbers(plan: ControlPlan) -> set[tuple[str, str]]:
        return {(name, str(index)) for each in plan.places for name, index in each}

    return not numbers(one).isdisjoint(numbers(other))


Begun = Mapping[str, NDArray]
"""Parameters that are planned to change, by name, as they were when the simulation began"""


class Turn(NamedTuple):
    """Values that one number of a control takes."""

    path: str
    axis: int
    frames: wp.array
    """Frames of a world at whose start it changes, in order"""
    values: wp.array
    """Values from then on"""


class Appearance(NamedTuple):
    """Sizes that a thing takes, one that appears later or ends."""

    name: str
    """Parameter that is 0 while it is not there"""
    number: int
    frames: wp.array
    """Frames of a world at whose start it changes, in order"""
    sizes: wp.array
    """Values from then on"""
    first: float
    """Value as a world begins"""


def begun_of(model: Model) -> Begun:
    """Copy the parameters that planned changes set, as a simulation begins."""
    names = dict.fromkeys(name for change in model.due_changes for name in change.values)
    return {name: np.array(model.parameters[name].numpy()) for name in names}


def _appearances(model: Model, begun: Begun) -> Iterator[Appearance]:
    """Find the spheres and strings that appear later or end."""
    scene, device = model.scene, model.device
    said = scene_parameters(scene, rows_of(model.laws))
    for name, things in (("sphere_radius", scene.sphere), ("string_stiffness", scene.string)):
        for number, thing in enumerate(things):
            frames = sorted({frame_at(scene, time) for time in (thing.start, thing.end) if time})
            if frames:
                sizes = [said[name][0, number] * is_there(scene, thing, frame) for frame in frames]
                yield Appearance(
                    name,
                    number,
                    wp.array(frames, dtype=wp.int32, device=device),
                    wp.array(sizes, dtype=wp.float32, device=device),
                    float(begun[name][0, number]),
                )


def has_times(model: Model) -> bool:
    """Return whether a scene has things with times: changes, keyframes, moving obstacles, things that appear or end.

    The default pressure has keyframes, too: it rises from zero.
    """
    moves = any(np.ptp(np.asarray(each.numpy()), axis=0).any() for each in (model.obstacle_motion, model.anchor_motion))
    keyed = model.keyframe_times.shape[1] > 1
    return bool(model.due_changes or keyed or moves)


def require_timeless(model: Model) -> None:
    """Make sure that nothing in a scene depends on the clock of all worlds.

    Raises:
        InputError: something does.
    """
    scene = model.scene
    ties = any(string.start > 0.0 or string.end is not None for string in scene.string)
    necks = [balloon.neck for balloon in scene.balloon if balloon.neck]
    fills = (model.parameters[f"fill_{name}"].numpy() for name in ("breaths", "litres", "moles"))
    blown_in = sum(float(np.sum(fill)) for fill in fills)
    reasons = {
        'strings that appear or end, and solver = "projective"': ties and scene.solver == "projective",
        "a neck that opens or closes": any(neck.opens > 0.0 or neck.closes is not None for neck in necks),
        "gas that is blown in for a time": blown_in > 0.0,
        "a needle_time": any(balloon.material.needle_time < NEVER for balloon in scene.balloon),
    }
    if reason := next((name for name, depends in reasons.items() if depends), None):
        raise InputError(f"reset: some worlds cannot begin anew where the scene has {reason}: the clock is that of all")


class Timetable:
    """The changes that a scene plans, each in the frame of a world's own time.

    Args:
        controls: in which changed paths are opened, where they are not open yet.
        begun: parameters at the start.
        frame: how many frames all worlds have had.

    Raises:
        InputError: something that is planned cannot be written on the device.
    """

    def __init__(self, model: Model, controls: Controls, begun: Begun, frame: int):
        self._controls, self._device = controls, model.device
        self._turns: list[Turn] = []
        self.ages = wp.full(model.world_count, frame, dtype=wp.int32, device=model.device)
        """Number of frames since each world began"""
        for path, planned in _planned(model.scene).items():
            first = _first_values(model, path, begun)
            told = [first, *(value for _, value in planned)]
            try:
                if path not in controls:
                    controls.open_planned(path, first, float(np.min(told)), float(np.max(told)))
            except InputError as mistake:
                raise InputError(f"reset: some worlds cannot begin anew by themselves: change: {mistake}") from None
            frames = wp.array([at for at, _ in planned], dtype=wp.int32, device=model.device)
            for axis in range(len(first)):
                values = wp.array([value[axis] for _, value in planned], dtype=wp.float32, device=model.device)
                self._turns.append(Turn(path, axis, frames, values))

        self._appearances = list(_appearances(model, begun))
        self._nobody = wp.zeros(model.world_count, dtype=wp.int32, device=model.device)

    def write(self, model: Model) -> None:
        """Write the values planned for the frame that each world begins."""
        self._appear(model, self._nobody)
        count, device = self.ages.shape[0], self._device
        for turn in self._turns:
            target = self._controls.column(turn.path, turn.axis)
            launch(follow_plan, count, [self.ages, turn.frames, turn.values], [target], device=device)

    def restart(self, mask: wp.array, model: Model) -> None:
        """Let the time of worlds begin anew."""
        launch(begin_ages, self.ages.shape[0], [mask], [self.ages], device=self._device)
        self._appear(model, mask)

    def settle(self, model: Model) -> None:
        """Let things appear and end, after the time of worlds has been set."""
        self._appear(model, wp.ones_like(self._nobody))

    def _appear(self, model: Model, mask: wp.array) -> None:
        for each in self._appearances:
            (target,) = columns_of(model.parameters[each.name], (each.number,))
            inputs = [mask, self.ages, each.frames, each.sizes, each.first]
            launch(let_appear, self.ages.shape[0], inputs, [target], device=self._device)


def _planned(scene: Scene) -> dict[str, list[tuple[int, NDArray[np.float64]]]]:
    """Return the frames of each path's changes, and its values from then on, shape (1,) or (3,).

    Raises:
        InputError: a change is of a method, or of more than a number or a vector.
    """
    planned: dict[str, dict[int, NDArray[np.float64]]] = {}
    for number, path, frame, value in _changes(scene):
        where = f"reset: some worlds cannot begin anew by themselves: change.{number}.set: {path}"
        if path in METHODS:
            raise InputError(f"{where}: changes in all worlds at once")
        numbers = [value] if isinstance(value, int | float) else value
        if not isinstance(numbers, list | tuple) or not all(isinstance(each, int | float) for each in numbers):
            raise InputError(f"{where}: must be a number or three (got {str(value)[:60]})")
        planned.setdefault(path, {})[frame] = np.array(numbers, dtype=np.float64)
    return {path: sorted(turns.items(), key=lambda turn: turn[0]) for path, turns in planned.items()}


def _changes(scene: Scene) -> Iterator[tuple[int, str, int, Any]]:
    for number, change in enumerate(scene.change):
        for path, value in change.set.items():
            yield number, path, frame_at(scene, change.time), value


def _first_values(model: Model, path: str, begun: Begun) -> NDArray[np.float64]:
    """Return the value of a path as the simulation began, alike in all worlds, shape (1,) or (3,)."""
    places = places_of(model.scene, rows_of(model.laws))
    firsts = [places[each][0] for each in (path, *(f"{path}.{axis}" for axis in range(3))) if each in places]
    rows = {name: begun[name] if name in begun else model.parameters[name].numpy() for name, _ in firsts}
    return np.array([np.ravel(rows[name][(0, *index)])[0] for name, index in firsts], dtype=np.float64)

"""Plan of a control: the parameters that it writes, their bounds, and the model with them."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Literal

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Parameter
from balloon_warp.kernels.laws.law import FAR
from balloon_warp.model import Model
from balloon_warp.model.parameters import Place, places_of
from balloon_warp.model.rows import VELOCITY, rows_of
from balloon_warp.model.setting import plan_setting
from balloon_warp.model.stability import names_of_the_step
from balloon_warp.model.vary import require_changeable

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

"""Values that change while a model is simulated: as planned, or as somebody sets them."""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Parameter
from balloon_warp.model.model import Model
from balloon_warp.model.obstacles import substeps_of_solids
from balloon_warp.model.parameters import (
    KEYFRAME_VALUES,
    METHODS,
    DueChange,
    Parameters,
    Place,
    check_vary,
    places_of,
    require_changeable,
    rows_of,
    scene_parameters,
    with_law_tables,
)
from balloon_warp.model.plan import substeps_over_time
from balloon_warp.model.stability import Network, names_of_the_step, update_dependents
from balloon_warp.scene import Scene
from balloon_warp.scene.load import is_there, override_scene


class PlannedChanges:
    """The changes that are still to come, in order."""

    def __init__(self, changes: Iterable[DueChange]):
        self._ahead = deque(changes)

    def __iter__(self) -> Iterator[DueChange]:
        return iter(self._ahead)

    def are_due(self, frame: int) -> bool:
        """Return whether a change is due at the start of a frame."""
        return bool(self._ahead) and self._ahead[0].frame <= frame

    def due(self, frame: int) -> Iterator[DueChange]:
        """Take the changes that are due at the start of a frame, one after the other."""
        while self.are_due(frame):
            yield self._ahead.popleft()

    def clear(self) -> None:
        """Drop all planned changes."""
        self._ahead.clear()


def changed_parameters(change: DueChange, model: Model) -> dict[str, NDArray]:
    """Find a model's parameters that change, and those that follow from them, with their rows from then on."""
    now = {name: array.numpy().astype(np.float64) for name, array in model.parameters.items()}
    then = now | {name: now[name].copy() for name in change.values}
    for name in change.values:
        change.apply(name, then[name])
    update_dependents(change.scene, model.shapes, now, then)
    return {name: rows for name, rows in then.items() if rows is not now[name]}


def with_changed_methods(change: DueChange, model: Model) -> Model:
    """Return a model with the methods that change."""
    methods = {name: getattr(change.scene, name) for name in change.methods}
    asked = methods.get("substeps", "auto")
    substeps = model.substeps if asked == "auto" else asked
    return replace(model, scene=model.scene.model_copy(update=methods), substeps=substeps)


LASTING = {"sphere_radius": "sphere", "string_stiffness": "string"}
"""Parameters that are 0 for absent items"""


@dataclass(frozen=True)
class Setting:
    """Checked values that are about to be set."""

    scene: Scene
    """Scene from now on; values that differ between worlds are those of the first world"""
    parameters: Parameters
    """Parameters that change, with a row for each world, or one for all"""
    substeps: int
    """Number of substeps in a frame from now on, by the scene, or as all worlds need"""

    def differs_by_world(self, model: Model) -> bool:
        """Return whether the setting has values for each world, where a model has one for all."""
        return any(len(rows) > model.parameters[name].shape[0] for name, rows in self.parameters.items())

    def changes_methods(self, model: Model) -> bool:
        """Return whether the steps of a model's frame change, in kind or number."""
        alike = all(getattr(self.scene, name) == getattr(model.scene, name) for name in METHODS)
        return not alike or self.substeps != model.substeps


def plan_setting(model: Model, changes: Mapping[str, Any], planned: Sequence[DueChange], frame: int) -> Setting:
    """Check values that are to be set, and find those that follow from them.

    Args:
        model: as it is now, its scene and its parameters.
        changes: dotted paths as in overrides, and values; or for a number, or the numbers of a vector, an array with
            one for each world.
        planned: changes that the scene still plans.
        frame: that is simulated next.

    Raises:
        InputError: names the path or field that is wrong, or cannot change; or the step would not be stable.
    """
    if not isinstance(changes, Mapping):
        raise InputError(f'set: must be paths and values, as in {{"balloon.mass": 2.0}} (got {str(changes)[:60]})')
    rows = rows_of(model.laws)
    told = list(_told(model, rows, changes))
    alike = [(path, value) for path, value, _ in told]
    scene = with_law_tables(override_scene(model.scene, alike), rows)
    require_changeable(model.scene, rows, (path for path, _ in alike), mass_follows=True)
    _require_same_things(model.scene, scene, rows)
    now: Parameters = {name: array.numpy().astype(np.float64) for name, array in model.parameters.items()}
    then = dict(now)
    said, places = scene_parameters(scene, rows), places_of(model.scene, rows)
    for path, _, by_world in told:
        for name, index in _places_under(places, path):
            _require_there(model.scene, path, name, index, frame)
            value = _said_at(said, path, name, index) if by_world is None else by_world
            if path in places or not np.isnan(value).any():  # in a table some are left to us
                then[name] = _put(then[name], index, _number(path, value))
    update_dependents(scene, model.shapes, now, then)
    different = {name: values for name, values in then.items() if not np.array_equal(values, now[name])}
    return Setting(scene, different, _substeps(model, scene, then, {*different}, planned))


def _told(
    model: Model, rows: Sequence[Parameter], changes: Mapping[str, Any]
) -> Iterator[tuple[str, Any, NDArray[np.float64] | None]]:
    """Return paths with values for the scene, and for each world where given; a vector has a path a number."""
    places = places_of(model.scene, rows)
    for path, value in changes.items():
        size = 0 if isinstance(value, str) else np.ndim(np.asarray(value, dtype=object))
        axes = [known for known in places if known.startswith(f"{path}.")]
        columns = {}
        if path in places and size == 1:
            columns = {path: value}
        elif path not in places and size == 2 and np.asarray(value).shape[1] == len(axes):
            columns = dict(zip(axes, np.asarray(value).T, strict=True))
        for each, values in check_vary(model.scene, rows, model.world_count, columns).items():
            yield each, float(values[0]), values
        if not columns:
            yield path, value, None


def _places_under(places: Mapping[str, Sequence[Place]], path: str) -> list[Place]:
    """Return the places of a number, or of all numbers in a table or a vector."""
    below = (each for known, found in places.items() if known.startswith(f"{path}.") for each in found)
    return list(places[path]) if path in places else list(below)


def _require_same_things(before: Scene, after: Scene, rows: Sequence[Parameter]) -> None:
    """Make sure that there are as many things, and that no balloon begins, or ceases, to soften or to burst.

    Raises:
        InputError: it is not so.
    """
    first, second = ({path for path, found in places_of(scene, rows).items() if found[0][0] != KEYFRAME_VALUES.name}
                     for scene in (before, after))  # fmt: skip
    different = {path.rpartition(".")[0] for path in first ^ second}
    for number, pair in enumerate(zip(before.balloon, after.balloon, strict=False)):
        for field in ("softening", "strength"):
            if len({getattr(balloon.material, field) is None for balloon in pair}) > 1:
                different.add(f"balloon.{number}.material.{field}")
    if different:
        raise InputError(f"{min(different)}: cannot start or stop acting during the simulation")


def _require_there(scene: Scene, path: str, name: str, index: Sequence[Any], frame: int) -> None:
    """Make sure that a sphere or string is there.

    Raises:
        InputError: it is not.
    """
    if name in LASTING and not is_there(scene, getattr(scene, LASTING[name])[index[0]], frame):
        raise InputError(f"{path}: {LASTING[name]} {index[0]} does not exist in frame {frame}")


def _said_at(said: Parameters, path: str, name: str, index: Sequence[Any]) -> float:
    """Return a scene's value at a place of a parameter, NaN where it is "auto".

    Raises:
        InputError: it says keyframes.
    """
    values = np.unique(said[name][(0, *index)])
    if len(values) > 1 and not np.isnan(values).any():
        raise InputError(f"{path}: must be a number during the simulation (got keyframes)")
    return float(values[-1])  # where NaN comes


def _number(path: str, value: Any) -> Any:
    """Return a value that the scene must say itself.

    Raises:
        InputError: it is.
    """
    if np.isnan(value).any():
        raise InputError(f'{path}: must be a number during the simulation (got "auto")')
    return value


def _put(rows: NDArray[np.float64], index: Sequence[Any], value: Any) -> NDArray[np.float64]:
    """Return rows with another value at a place, or with one for each world."""
    values = np.ravel(value)
    rows = np.repeat(rows, len(values), axis=0) if len(rows) == 1 else rows.copy()
    target = rows[(slice(None), *index)]
    target[...] = values.reshape(-1, *([1] * (target.ndim - 1)))
    return rows


def _substeps(model: Model, scene: Scene, then: Parameters, different: set[str], planned: Sequence[DueChange]) -> int:
    """Return the substeps of a frame from now on.

    Raises:
        InputError: the scene says too few, or a value that differs between worlds is planned to change.
    """
    methods_change = any(getattr(scene, name) != getattr(model.scene, name) for name in METHODS)
    if not methods_change and names_of_the_step(scene, model.laws).isdisjoint(different):
        return model.substeps
    particles = model.string_particle.numpy()
    held = [int(particle) - model.particle_offsets[string.balloon]
            for string, particle in zip(scene.string, particles, strict=True)]  # fmt: skip
    network = Network(model.shapes, held, model.laws, model.bodies)
    substeps = substeps_over_time(scene, network, then, planned, None)
    return max(substeps, substeps_of_solids(scene, model.bodies, then)) if scene.substeps == "auto" else substeps

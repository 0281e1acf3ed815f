"""Values that vary between worlds, and values that may change during a simulation.

Timeline of the parameters that change, and selection of the laws and phases that act.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, Protocol

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray
from typing_extensions import TypeAliasType

from balloon_warp.errors import InputError
from balloon_warp.kernels.features import Kept
from balloon_warp.kernels.laws import Law, Parameter
from balloon_warp.kernels.laws.membrane import THICKNESS
from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.substep import conditional_phases
from balloon_warp.mesh.load import LOADERS
from balloon_warp.model.parameters import (
    KEYFRAME_VALUES,
    START,
    Parameters,
    Place,
    is_numbered,
    parameters_at,
    places_of,
    with_law_tables,
)
from balloon_warp.scene import Scene, SceneLike, load_scene
from balloon_warp.scene.inflation_kinds import KIND_OF_FIELD
from balloon_warp.scene.load import Override, OverrideError, override_scene, pairs_of, scenes_over_time
from balloon_warp.scene.presets import standard_air

Vary = TypeAliasType("Vary", Mapping[str, ArrayLike])
"""Values in each world, shape (world_count,), by dotted paths of the scene, as in overrides"""
SHAPING = re.compile(r"balloon\.(\d+\.)?(mesh|scale|stiffness\.(variation|seed|gradient\.[01]))")
"""Paths whose values make another model: batches group their worlds by them"""
ALTITUDE = "atmosphere.altitude"
"""Path of which other values follow"""
METHODS = ("substeps", "solver", "normals", "correction", "correction_sweeps", "contact")
"""Fields of the scene that are no parameters, and may change during a simulation all the same"""
SURROUNDINGS = ("ground", "water", "touch")
"""Tables that a scene has once or not at all"""


class VaryError(InputError):
    """Mistake in values that vary between worlds.

    Args:
        mistake: Sentence on the mistake.
        path: Path at fault, as it was given.
    """

    def __init__(self, mistake: object, path: str):
        super().__init__(str(mistake))
        self.path = path


def worlds_of(world_count: int | None, vary: Mapping[str, Any] | None) -> int:
    """Return the number of worlds: as asked for, or else as many as the first path of `vary` has values."""
    first = next(iter((vary or {}).values()), None) if isinstance(vary, Mapping) else None
    return world_count if world_count is not None else len(first) if isinstance(first, Sized) else 1


def vary_parameters(
    parameters: Parameters, scene: Scene, rows: Sequence[Parameter], world_count: int, vary: Vary
) -> Parameters:
    """Return the parameters with a value for each world where `vary` has them.

    Raises:
        VaryError: names the path, and the world whose value the scene's schema refuses; or the paths that can vary.
    """
    places = places_of(scene, rows)
    varied = dict(parameters)
    for path, values in check_vary(scene, rows, world_count, vary).items():
        for name, index in places[path]:
            if varied[name] is parameters[name]:
                varied[name] = np.repeat(parameters[name], world_count, axis=0)
            target = varied[name][(slice(None), *index)]
            target[...] = values.reshape(-1, *([1] * (target.ndim - 1)))
    return varied


def check_vary(scene: Scene, rows: Sequence[Parameter], world_count: int, vary: Vary) -> dict[str, NDArray[np.float64]]:
    """Return the varied values as arrays of shape (world_count,), all of them fit for the scene.

    Raises:
        VaryError: as `vary_parameters`.
    """
    places = places_of(scene, rows)
    checked = {}
    for path, given in vary.items():
        try:
            if path == ALTITUDE:
                checked |= _air_at(scene, _checked(scene, rows, path, given, world_count), vary)
                continue
            if path not in places:
                _refuse(scene, rows, path, given, places)
            checked[path] = _checked(scene, rows, path, given, world_count)
        except InputError as mistake:
            raise VaryError(mistake, path) from None
    return checked


def _air_at(scene: Scene, altitudes: NDArray[np.float64], vary: Vary) -> dict[str, NDArray[np.float64]]:
    """Return the values that follow from the altitude of each world, without those that are given."""
    airs = [standard_air(altitude) for altitude in altitudes.tolist()]
    columns = {f"atmosphere.{field}": np.array([air[field] for air in airs]) for field in scene.atmosphere.following}
    return {path: column for path, column in columns.items() if path not in vary}


def _refuse(
    scene: Scene, rows: Sequence[Parameter], path: str, given: ArrayLike, places: Mapping[str, list[Place]]
) -> NoReturn:
    """Raise an error that says why a path cannot vary between worlds."""
    if path not in Scene.model_fields:  # a wrong nested path raises here
        _require_fit(scene, rows, path, np.ravel(given).tolist()[0])
    table = path.partition(".")[0]
    if table in SURROUNDINGS and not getattr(scene, table):
        raise InputError(f"{path}: cannot differ between worlds, the scene has no {table}")
    if SHAPING.fullmatch(path):
        raise InputError(f"{path}: needs a model for each world; batches and `simulate` can vary it")
    names = ", ".join(_summary(places))
    raise InputError(f"{path}: cannot differ between worlds, only between runs of `compare`; what can: {names}")


def require_changeable(
    scene: Scene, rows: Sequence[Parameter], paths: Iterable[str], mass_follows: bool = False
) -> None:
    """Make sure that values may change while the scene is simulated.

    Args:
        mass_follows: whether the mass of rubber and film follows a change of its thickness.

    Raises:
        InputError: names the path that may not.
    """
    places = places_of(scene, rows)
    for path in paths:
        named = [place for known, place in places.items() if known == path or known.startswith(f"{path}.")]
        names = {name for place in named for name, _ in place}
        if THICKNESS.name in names and not mass_follows:
            raise InputError(f"{path}: cannot change, since the balloon's mass follows from it")
        at_start = any(name.startswith(START) for name in names)
        if path not in METHODS and (at_start or not named):
            methods = ", ".join(METHODS)
            raise InputError(f"{path}: cannot change; what can: {methods}, and what may differ between worlds")


def _checked(
    scene: Scene, rows: Sequence[Parameter], path: str, given: ArrayLike, world_count: int
) -> NDArray[np.float64]:
    """Return the values of one path, each fit for the scene: bounds are intervals, so the extremes speak for all."""
    try:
        values = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{path}: expected a number for each world (got {str(given)[:60]})") from None
    if values.shape != (world_count,):
        raise InputError(f"{path}: expected a value for each of {world_count} worlds (got shape {values.shape})")
    wild = ~np.isfinite(values)
    for world in [wild.argmax()] if wild.any() else [values.argmin(), values.argmax()]:
        try:
            _require_fit(scene, rows, path, float(values[world]))
        except InputError as mistake:
            raise InputError(f"{mistake}, in world {world}") from None
    return values


def _require_fit(scene: Scene, rows: Sequence[Parameter], path: str, value: object) -> None:
    """Make sure that the scene may have a value at a path."""
    with_law_tables(override_scene(scene, [(path, value)]), rows)


def _summary(places: Mapping[str, list[Place]]) -> list[str]:
    """Return the paths without the numbers of balloons, spheres, strings and tubes, the scene's own fields first."""
    return sorted((path for path in (*places, ALTITUDE) if not is_numbered(path)), key=lambda path: path.count("."))


FILLING = re.compile(r"balloon\.(?:(\d+)\.)?inflation\.(\w+)")
"""Paths of fields of inflations"""


def scene_to_vary(
    source: SceneLike, vary: Mapping[str, Any] | None, overrides: Mapping[str, Any] | Iterable[Override] = ()
) -> Scene:
    """Load a scene whose values at some paths will differ between worlds.

    As with `--set`, a balloon gets the kind of inflation that they ask for, where nothing names one; and a mesh by
    itself gets no pump beside litres that differ.

    Args:
        source: as of `load_scene`.
        vary: values that differ, by dotted paths.
        overrides: as of `load_scene`.

    Raises:
        InputError: as `load_scene`.
        VaryError: no world can have the largest of the values at a path.
    """
    asked = _fillings(vary) if isinstance(vary, Mapping) else []
    if _is_bare_mesh(source):
        given = pairs_of(overrides)
        try:
            return load_scene(source, [*given, *asked])
        except OverrideError as mistake:
            if mistake.number < len(given):
                raise
            raise VaryError(mistake, asked[mistake.number - len(given)][0]) from None
    scene = source if isinstance(source, Scene) and not overrides else load_scene(source, overrides)
    for path, value in asked:
        if _asks_for_another_kind(scene, path):
            try:
                scene = override_scene(scene, [(path, value)], other_kinds=True)
            except InputError as mistake:
                raise VaryError(mistake, path) from None
    return scene


def _is_bare_mesh(source: SceneLike) -> bool:
    if isinstance(source, str | Path):
        return Path(source).suffix.lower() in LOADERS
    return not isinstance(source, Scene)


def _fillings(vary: Mapping[str, Any]) -> list[Override]:
    """Return paths of inflations among those that differ, and the value of each that is farthest from 0."""
    asked: list[Override] = []
    for path, values in vary.items():
        named = FILLING.fullmatch(path)
        if named and named[2] in KIND_OF_FIELD:
            try:
                numbers: Sequence[float] = np.ravel(np.asarray(values, dtype=np.float64)).tolist()
            except (TypeError, ValueError):  # which is complained of with all that differs
                continue
            if np.isfinite(numbers).any():
                asked.append((path, max(filter(np.isfinite, numbers), key=abs)))
    return asked


def _asks_for_another_kind(scene: Scene, path: str) -> bool:
    """Return whether a path belongs to another kind of inflation than its balloons have, all of which leave it open."""
    named = FILLING.fullmatch(path)
    assert named
    balloons = scene.balloon[int(named[1]) :][:1] if named[1] else scene.balloon
    inflations = [balloon.inflation for balloon in balloons]
    return not any(each.names_its_kind for each in inflations) and any(
        each.kind != KIND_OF_FIELD[named[2]] for each in inflations
    )


@dataclass(frozen=True)
class DueChange:
    """A frame at whose start parameters change, alike in all worlds."""

    frame: int
    scene: Scene
    """Scene from then on"""
    values: dict[str, tuple[NDArray[np.bool_], NDArray[np.float64]]]
    """Changed entries of a world and their new values, by the parameters' names"""
    methods: frozenset[str]
    """Changed fields among `METHODS`"""

    def apply(self, name: str, rows: NDArray) -> None:
        """Change a parameter's rows, shape (W, ...), in place."""
        which, values = self.values[name]
        rows[:, which] = values[which]


def due_changes(scene: Scene, rows: Sequence[Parameter]) -> Iterator[DueChange]:
    """Find the changes that a scene plans, in order.

    Raises:
        InputError: names the change, and the path or field that is wrong.
    """
    for number, change in enumerate(scene.change):
        try:
            require_changeable(scene, rows, change.set)
            if automatic := [path for path, value in change.set.items() if value == "auto" and path != "substeps"]:
                raise InputError(f'{automatic[0]}: must be a number or keyframes (got "auto")')
        except InputError as mistake:
            raise InputError(f"change.{number}.set: {mistake}") from None
    before, scene_before = parameters_at(scene, rows, 0), scene
    for frame, now in scenes_over_time(scene):
        with_law_tables(now, rows)
        _require_same_times(scene, now)
        after = parameters_at(now, rows, frame)
        keyframes = before[KEYFRAME_VALUES.name].shape[2] - after[KEYFRAME_VALUES.name].shape[2]
        padding = [(0, 0), (0, 0), (0, keyframes)]
        after[KEYFRAME_VALUES.name] = np.pad(after[KEYFRAME_VALUES.name], padding, mode="edge")
        values = {
            name: (different, array[0])
            for name, array in after.items()
            if (different := (array[0] != before[name][0]) & ~np.isnan(array[0])).any()
        }
        methods = frozenset(name for name in METHODS if getattr(now, name) != getattr(scene_before, name))
        yield DueChange(frame, now, values, methods)
        before, scene_before = after, now


def _require_same_times(scene: Scene, now: Scene) -> None:
    """Make sure that keyframes come when they do at the start: only their values change.

    Raises:
        InputError: names the balloon whose keyframes have other times.
    """
    for number, (first, then) in enumerate(zip(scene.balloon, now.balloon, strict=True)):
        told, found = ([time for time, _ in balloon.inflation.keyframes] for balloon in (first, then))
        if then.inflation.has_keyframes and found != told:
            expected = f"keyframes at {told} s" if first.inflation.has_keyframes else "keyframes from the start on"
            raise InputError(
                f"change: balloon.{number}.inflation.{then.inflation.keyframed}: must be a number, or {expected} "
                f"(got keyframes at {found} s)"
            )


class Parametrized(Protocol):
    """A model, or the plan of one."""

    @property
    def scene(self) -> Scene: ...

    @property
    def laws(self) -> tuple[Law, ...]: ...

    @property
    def parameters(self) -> Mapping[str, Any]: ...

    @property
    def due_changes(self) -> Sequence[DueChange]: ...

    @property
    def reach(self) -> Mapping[str, Sequence[NDArray[np.float32]]]: ...


def active_laws(model: Parametrized) -> tuple[Law, ...]:
    """Return the laws that act in any world at any time: the scene has them, and their parameters are not neutral."""
    return tuple(law for law in model.laws if _is_active(law, model))


def active_phases(model: Parametrized) -> tuple[Phase, ...]:
    """Return the phases of the step that act in any world at any time, of those that ask for it as laws do."""
    return tuple(phase for phase in conditional_phases() if _is_active(phase, model))


def active_laws_and_phases(model: Parametrized) -> tuple[Law | Phase, ...]:
    """Return the laws and phases that act."""
    return (*active_laws(model), *active_phases(model))


def kept_values(model: Parametrized) -> tuple[Kept, ...]:
    """Return the values that items keep from substep to substep."""
    return tuple(kept for phase in active_phases(model) for kept in phase.kept)


def _is_active(each: Law | Phase, model: Parametrized) -> bool:
    """Return whether a scene has a law or phase, with parameters that are not always neutral."""
    return (each.wants is None or each.wants(model.scene)) and not _rests(each, model)


def _rests(each: Law | Phase, model: Parametrized) -> bool:
    return bool(each.neutral) and all(
        (values == np.float32(neutral)).all()
        for name, neutral in each.neutral.items()
        for values in values_over_time(model, name)
    )


def values_over_time(model: Parametrized, name: str) -> Iterator[NDArray[np.float32]]:
    """Iterate over a parameter's values in all worlds: at the start, after each change, and at a control's bounds."""
    rows = model.parameters[name]
    yield np.asarray(rows.numpy() if isinstance(rows, wp.array) else rows, dtype=np.float32)
    for change in model.due_changes:
        if name in change.values:
            yield np.asarray(change.values[name][1], dtype=np.float32)
    yield from model.reach.get(name, ())

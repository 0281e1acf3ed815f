"""Parameters: their rows in memory, their values from a scene and the paths there, and those that vary or change."""

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
from balloon_warp.kernels.laws import Columns, Law, Parameter, columns_of
from balloon_warp.kernels.laws.law import TINY
from balloon_warp.kernels.laws.membrane import SOFTENING_PARAMETERS, TEARING_PARAMETERS, THICKNESS
from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.substep import conditional_phases, rows_of_phases
from balloon_warp.mesh.load import LOADERS
from balloon_warp.scene import Inflation, Material, Scene, SceneLike, load_scene
from balloon_warp.scene.fields import standard_air
from balloon_warp.scene.load import (
    KIND_OF_FIELD,
    Override,
    OverrideError,
    is_there,
    override_scene,
    pairs_of,
    scenes_over_time,
)

START = "initial_"
"""Prefix of the names of parameters that count at the start alone, and so cannot change"""
KEYFRAME_VALUES = Parameter(
    "keyframe_values",
    "N, Pa or mol/s",
    path="inflation.k_normal, inflation.pressure or inflation.pump",
    meaning="keyframed value by the kind of inflation, at each keyframe",
)
VELOCITY = "obstacle_velocity"
"""Parameter that only controls have: velocities of obstacles beside their motion [m/s]"""
ROWS: tuple[Parameter, ...] = (
    Parameter("initial_balloon_positions", "m", path="position", size=3),
    Parameter("initial_rotations", "degrees", path="rotation", size=3),
    Parameter("initial_velocities", "m/s", path="velocity", size=3),
    Parameter("initial_spins", "rad/s", path="angular_velocity", size=3),
    Parameter("initial_gas_amounts", "mol", np.nan, least=0.0, path="inflation.amount"),
    Parameter("initial_density", "kg/m^3", 940.0, least=TINY, path="material.density"),
    *SOFTENING_PARAMETERS,
    *TEARING_PARAMETERS,
    Parameter("initial_pressures", "Pa", path="inflation.start_pressure", meaning="gauge pressure of a gas"),
    Parameter("initial_sphere_positions", "m", of="sphere", path="position", size=3),
    Parameter("initial_sphere_velocities", "m/s", of="sphere", path="velocity", size=3),
    Parameter("initial_sphere_spins", "rad/s", of="sphere", path="angular_velocity", size=3),
    Parameter("string_anchor", "m", of="string", path="anchor", size=3),
    Parameter("string_length", "m", np.nan, least=TINY, of="string", path="length"),
    Parameter("string_stiffness", "N/m", 20.0, least=TINY, of="string", path="stiffness"),
    Parameter("obstacle_position", "m", of="obstacle", path="position", size=3),
    Parameter("obstacle_friction", "1", 0.5, least=0.0, of="obstacle", path="friction"),
    Parameter("obstacle_restitution", "1", 0.3, least=0.0, most=1.0, of="obstacle", path="restitution"),
    Parameter("initial_body_positions", "m", of="body", path="position", size=3),
    Parameter("initial_body_velocities", "m/s", of="body", path="velocity", size=3),
    Parameter("initial_body_spins", "rad/s", of="body", path="angular_velocity", size=3),
    Parameter("body_mass", "kg", np.nan, least=TINY, of="body", path="mass"),
    Parameter("body_friction", "1", 0.5, least=0.0, of="body", path="friction"),
    Parameter("body_restitution", "1", 0.3, least=0.0, most=1.0, of="body", path="restitution"),
    Parameter("tube_conductance", "mol/(s Pa)", least=0.0, of="tube", path="conductance"),
    Parameter("force_newtons", "N", of="force", path="newtons", size=3),
)
"""NaN is settled once all is known: a string's length, a body's mass, and an amount of gas"""


def all_columns(laws: Sequence[Law]) -> Columns:
    """Return the columns of the parameters of these laws and of the phases of the step."""
    return columns_of(laws, rows_of_phases())


def rows_of(laws: Sequence[Law]) -> tuple[Parameter, ...]:
    """Return the parameters of these laws and of the phases of the step, and all others but the keyframes.

    A balloon has several keyframes.
    """
    columns = all_columns(laws)
    return (*columns.world, *columns.balloon, *columns.sphere, *ROWS)


def pack(columns: Columns, parameters: Mapping[str, NDArray[np.float64]], device: wp.Device) -> dict[str, wp.array]:
    """Return the numbers of balloons and spheres, shape (W, count, width), and of worlds, shape (W, width)."""
    rows = {"balloon_numbers": columns.balloon, "sphere_numbers": columns.sphere, "world_numbers": columns.world}
    return {name: wp.array(_beside(of, parameters), dtype=wp.float32, device=device) for name, of in rows.items()}


def views_of(
    columns: Columns, balloon_numbers: wp.array, world_numbers: wp.array, sphere_numbers: wp.array
) -> dict[str, wp.array]:
    """Return the parameters by name, shape (W, count) or (W,), with a last dimension of 3 for vectors."""
    views = {}
    for rows, numbers in (
        (columns.balloon, balloon_numbers),
        (columns.world, world_numbers),
        (columns.sphere, sphere_numbers),
    ):
        column, before = 0, (slice(None),) * (numbers.ndim - 1)
        for row in rows:
            own = column if row.size == 1 else slice(column, column + row.size)
            views[row.name] = numbers[(*before, own)] if numbers.size else _none(numbers, row)
            column += row.size
    return views


def _none(numbers: wp.array, row: Parameter) -> wp.array:
    """Return the parameter where there is nothing that has it; Warp takes no view of an empty array."""
    shape = (*numbers.shape[:-1], row.size) if row.size > 1 else numbers.shape[:-1]
    return wp.zeros(shape, dtype=wp.float32, device=numbers.device)


def _beside(rows: Sequence[Parameter], parameters: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the columns of all rows; where one differs between worlds, another's row stands for all worlds."""
    parts = [parameters[row.name][..., None] if row.size == 1 else parameters[row.name] for row in rows]
    worlds = max(len(part) for part in parts)
    return np.concatenate([np.broadcast_to(part, (worlds, *part.shape[1:])) for part in parts], axis=-1)


HOLDERS = ("balloon", "sphere")
"""Tables of a scene that have tables of laws and phases"""
Tables = dict[str, dict[str, Any]]
Rows = Mapping[str, Mapping[str, Parameter]]
"""Rows of parameters, by their laws' names and their own"""


def with_law_tables(scene: Scene, rows: Sequence[Parameter]) -> Scene:
    """Return the scene with these tables made sure of, and filled with the defaults of missing values.

    Raises:
        InputError: names the path and the expected value.
    """
    fields = {of: _by_law(row for row in rows if row.of == of) for of in ("world", *HOLDERS)}
    law = _filled("law", scene.law, fields["world"])
    filled = {
        of: [
            each.model_copy(update={"law": _filled(f"{of}.{number}.law", each.law, fields[of])})
            for number, each in enumerate(getattr(scene, of))
        ]
        for of in HOLDERS
    }
    return scene.model_copy(update={"law": law, **filled}) if any(fields.values()) else scene


def _by_law(rows: Iterable[Parameter]) -> Rows:
    fields: dict[str, dict[str, Parameter]] = {}
    for row in rows:
        if row.path.startswith("law."):
            _, law, field = row.path.split(".")
            fields.setdefault(law, {})[field] = row
    return fields


def _filled(path: str, tables: Tables, rows: Rows) -> Tables:
    for law, values in tables.items():
        if law not in rows:
            known = f"known here are {', '.join(rows)}" if rows else "no given law has parameters here"
            raise InputError(f"{path}.{law}: unknown law; {known}")
        for field, value in values.items():
            if field not in rows[law]:
                raise InputError(f"{path}.{law}.{field}: unknown field; known here are {', '.join(rows[law])}")
            _require_value(f"{path}.{law}.{field}", value, rows[law][field])
    defaults = {law: {field: _default(row) for field, row in fields.items()} for law, fields in rows.items()}
    return {law: {**fields, **tables.get(law, {})} for law, fields in defaults.items()}


def _default(row: Parameter) -> Any:
    return row.default if row.size == 1 else (row.default,) * row.size


def _require_value(path: str, value: Any, row: Parameter) -> None:
    if np.size(value) != row.size:
        expected = "a number" if row.size == 1 else f"{row.size} numbers"
        raise InputError(f"{path}: must be {expected} (got {value})")
    if np.min(value) < row.least:
        raise InputError(f"{path}: must be at least {row.least:g} (got {value})")
    if np.max(value) > row.most:
        raise InputError(f"{path}: must be at most {row.most:g} (got {value})")


Parameters = dict[str, NDArray[np.float64]]
"""Arrays by the names of their rows, shape (W, count of balloons or spheres or strings or tubes, size), without the
second where a parameter is the world's, and without the last where it is 1; W is world_count, or 1 if all are alike"""
Place = tuple[str, tuple[int | slice, ...]]
"""Name of an array of `Parameters`, and an index into each world's part of it"""


def scene_parameters(scene: Scene, rows: Sequence[Parameter]) -> Parameters:
    """Return the scene's parameters, the same for all worlds; NaN for a missing string length or amount of gas."""
    return {row.name: _values(scene, row) for row in rows} | {KEYFRAME_VALUES.name: _keyframe_values(scene)}


def parameters_at(scene: Scene, rows: Sequence[Parameter], frame: int) -> Parameters:
    """Return the scene's parameters, with zero size or stiffness for absent spheres and strings."""
    parameters = scene_parameters(scene, rows)
    for name, lasting in (("sphere_radius", scene.sphere), ("string_stiffness", scene.string)):
        parameters[name] = parameters[name] * [[is_there(scene, item, frame) for item in lasting]]
    return parameters


def places_of(scene: Scene, rows: Sequence[Parameter]) -> dict[str, list[Place]]:
    """Return the places of each path: one of `balloon.0.mass`, one for each balloon of `balloon.mass`."""
    places: dict[str, list[Place]] = {}
    for path, place in _numbered_places(scene, rows):
        places.setdefault(path, []).append(place)
        if is_numbered(path):
            table, _, field = path.split(".", 2)
            places.setdefault(f"{table}.{field}", []).append(place)
    return places


def is_numbered(path: str) -> bool:
    """Return whether a path leads to one balloon, sphere, string or tube."""
    return path.partition(".")[2].partition(".")[0].isdecimal()


def value_of(table: Any, row: Parameter) -> Any:
    """Return the value of a parameter in a scene, or in a body of it; its default where it is missing."""
    *inner, field = row.path.split(".")
    for name in inner:
        table = _field(table, name)
        if not table:
            return row.default if row.absent is None else row.absent
    value = _field(table, field)
    return row.default if value is None else value


def _values(scene: Scene, row: Parameter) -> NDArray[np.float64]:
    shape = (row.size,) if row.size > 1 else ()
    tables = _tables(scene, row)
    values = [np.broadcast_to(value_of(table, row), shape) for table in tables]
    array = np.array(values, dtype=np.float64).reshape(1, len(tables), *shape)
    return array[:, 0] if row.of == "world" else array


def _keyframe_values(scene: Scene) -> NDArray[np.float64]:
    """Return the keyframe values of all balloons, shape (1, balloon_count, keyframe_count).

    A shorter list repeats its last value.
    """
    lists = [[value for _, value in balloon.inflation.keyframes] for balloon in scene.balloon]
    longest = max(len(values) for values in lists)
    return np.array([[values + values[-1:] * (longest - len(values)) for values in lists]])


def _numbered_places(scene: Scene, rows: Sequence[Parameter]) -> Iterator[tuple[str, Place]]:
    for row in rows:
        for number, table in enumerate(_tables(scene, row)):
            if not _has(table, row.path):
                continue
            path, index = (row.path, ()) if row.of == "world" else (f"{row.of}.{number}.{row.path}", (number,))
            if row.size == 1:
                yield path, (row.name, index)
            for axis in range(row.size if row.size > 1 else 0):
                yield f"{path}.{axis}", (row.name, (*index, axis))
    for number, balloon in enumerate(scene.balloon):
        # As in overrides, a number takes the place of all keyframes, and a keyframe's value has a path of its own.
        path = f"balloon.{number}.inflation.{balloon.inflation.keyframed}"
        yield path, (KEYFRAME_VALUES.name, (number, slice(None)))
        if balloon.inflation.has_keyframes:
            for key in range(len(balloon.inflation.keyframes)):
                yield f"{path}.{key}.1", (KEYFRAME_VALUES.name, (number, key))


def _tables(scene: Scene, row: Parameter) -> Sequence[Any]:
    """Return the tables of the scene that have this parameter."""
    return [scene] if row.of == "world" else getattr(scene, row.of)


def _has(table: Any, path: str) -> bool:
    """Return whether a table has the fields that a path leads through.

    A scene may have no water, and an inflation only has the fields of its kind. Balloons that touch have all of
    `[touch]`, whether the scene has it or not.
    """
    *inner, field = path.split(".")
    for name in inner:
        if isinstance(table, Scene) and name == "touch" and table.touch is None:
            return table.touches
        table = _field(table, name)
        if not table or (isinstance(table, Inflation | Material) and field not in table.own_fields):
            return inner[0] == "law"
    return True


def _field(table: Any, name: str) -> Any:
    if isinstance(table, Material):
        return table.value(name)
    return table.get(name) if isinstance(table, dict) else getattr(table, name)


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

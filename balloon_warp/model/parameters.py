"""The parameters: their rows in memory, their values from a scene, and the paths at which they stand there."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Columns, Law, Parameter, columns_of
from balloon_warp.kernels.laws.law import TINY
from balloon_warp.kernels.laws.membrane import SOFTENING_PARAMETERS, TEARING_PARAMETERS
from balloon_warp.kernels.substep import rows_of_phases
from balloon_warp.scene import Inflation, Material, Scene
from balloon_warp.scene.load import is_there

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

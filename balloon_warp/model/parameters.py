"""The parameters: their values, from a scene, and the paths at which they stand there."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.laws import Parameter
from balloon_warp.model.rows import KEYFRAME_VALUES
from balloon_warp.scene import Inflation, Material, Scene
from balloon_warp.scene.timeline import is_there

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

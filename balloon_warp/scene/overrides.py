"""Overrides of scene values by dotted path: `balloon.inflation.k_normal=3`, `sphere.0.mass=100`."""

import tomllib
from collections.abc import Iterable
from typing import Any

from pydantic import ValidationError

from balloon_warp.errors import InputError
from balloon_warp.scene.complaint import complaint
from balloon_warp.scene.inflation_kinds import drop_masses, drop_other_kinds
from balloon_warp.scene.presets import PRESETS
from balloon_warp.scene.schema import MESHED, WITHOUT_MESHES, Scene

Override = tuple[str, Any]
"""Dotted path, and the value to set there"""
LISTED = ("balloon", "sphere", "string", "obstacle", "body", "tube", "force")
"""Tables that form lists, of which a path may give an index"""


class OverrideError(InputError):
    """An override is at fault.

    Args:
        mistake: the sentence.
        number: which override, counted from 0.
    """

    def __init__(self, mistake: str, number: int):
        super().__init__(mistake)
        self.number = number


def parse_override(text: str) -> Override:
    """Split `PATH=VALUE`; the value is read as TOML, and as plain text where it is no TOML value.

    Raises:
        InputError: there is no `=` or no path.
    """
    path, equals, value = text.partition("=")
    path = path.strip()
    if not equals or not all(path.split(".")):
        raise InputError(f"--set {text}: expected PATH=VALUE, as in --set balloon.inflation.k_normal=3")
    return path, parse_value(value)


def parse_value(text: str) -> Any:
    """Read a value as TOML has it, or as plain text where it is no TOML value."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):  # also thousands of digits, or brackets
        return text.strip()


def apply_overrides(table: dict[str, Any], overrides: Iterable[Override]) -> None:
    """Set each value at its path in the scene's table, in place.

    A list without a number in the path means all of it.

    Where the kind of an inflation is set, the table's fields of other kinds go; set values stay, in any order.

    Raises:
        OverrideError: a path leads through a value that has no fields, or past the end of a list.
    """
    pairs = list(overrides)
    drop_other_kinds(table, pairs)
    drop_masses(table, pairs)
    for number, (path, value) in enumerate(pairs):
        try:
            _put(table, path.split("."), value, path)
        except InputError as mistake:
            raise OverrideError(str(mistake), number) from None


def _put(place: Any, names: list[str], value: Any, path: str) -> None:
    name, rest = names[0], names[1:]
    if isinstance(place, list):
        listed = ".".join(path.split(".")[: -len(names)])
        if not place:
            raise InputError(f"{path}: cannot be set, the scene has no {listed}")
        if not name.isdecimal():
            for item in place:
                _put(item, names, value, path)
            return
        if int(name) >= len(place):
            raise InputError(f"{path}: no {listed} {name}, the scene has {len(place)}, counted from 0")
        if rest:
            _put(place[int(name)], rest, value, path)
        else:
            place[int(name)] = value
    elif isinstance(place, dict):
        if rest:
            listed = len(names) == path.count(".") + 1 and name in LISTED
            if place.get(name) is False:
                del place[name]  # "touch = false": a field of it asks for the table
            _put(place.setdefault(name, [] if listed else _of_preset(place, name)), rest, value, path)
        else:
            place[name] = value
    else:
        raise InputError(f"{path}: cannot be set, since a plain value has no field {name!r}")


def _of_preset(table: dict[str, Any], name: str) -> Any:
    """Read the numbers that a material's preset has under a name, to change one; or make a table of its own."""
    numbers = PRESETS.get(str(table.get("preset")), {}).get(name)
    return list(numbers) if isinstance(numbers, tuple) else {}


def override_scene(scene: Scene, overrides: Iterable[Override], other_kinds: bool = False) -> Scene:
    """Return a scene with other values at some paths. A mesh file is taken as given, not sought beside a scene file.

    Args:
        other_kinds: whether a field of another kind of inflation asks for that kind, where the scene names none, as in
            a scene file; a running scene keeps its own.

    Raises:
        InputError: names the path or field that is wrong.
    """
    table = scene.model_dump(mode="json", exclude_none=True, exclude=WITHOUT_MESHES)
    for name in MESHED:
        for plain, meshed in zip(table[name], getattr(scene, name), strict=True):
            if meshed.mesh is not None:
                plain["mesh"] = meshed.mesh
    for plain, balloon in zip(table["balloon"], scene.balloon, strict=True):
        if other_kinds and not balloon.inflation.names_its_kind:
            plain["inflation"] = {k: v for k, v in plain["inflation"].items() if k in balloon.inflation.own_fields}
    table["atmosphere"] = {k: v for k, v in table["atmosphere"].items() if k not in scene.atmosphere.following}
    apply_overrides(table, overrides)
    try:
        return Scene.model_validate(table)
    except ValidationError as error:
        raise InputError(complaint(error, Scene)) from None

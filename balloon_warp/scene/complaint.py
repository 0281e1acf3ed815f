"""A validation error in one sentence: the field, the value found, and the values expected."""

import re
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from balloon_warp.errors import ask, closest, did_you_mean
from balloon_warp.kernels.laws.law import TINY


def table_in(annotation: Any) -> type[BaseModel] | None:
    """Find the table that a field of this type has, or has a list of, if any."""
    if isinstance(annotation, type) and not typing.get_args(annotation):
        return annotation if issubclass(annotation, BaseModel) else None
    return next((found for part in typing.get_args(annotation) if (found := table_in(part))), None)


LISTS = ("balloon", "sphere", "string", "obstacle", "body", "tube", "force", "change")
"""Tables that may occur several times"""
ALSO_CALLED = {
    **dict.fromkeys(("fps", "frame_rate", "framerate"), "frames_per_second"),
    **dict.fromkeys(("duration", "seconds"), "frames"),
}
"""Fields by names that other programs have for them"""
MOST_ASKED = 4
"""Largest number of fields that a question names"""


def complaint(error: ValidationError, schema: type[BaseModel]) -> str:
    """Name the first wrong field, and its expected values.

    A value that fits no member of a union fails each of them: their expectations are joined by "or".
    """
    by_field: dict[str, list[ErrorDetails]] = {}
    for details in error.errors():
        if details["type"] == "callable_type":
            continue  # Python alone may give a function: there are other words for it
        by_field.setdefault(_field(details, schema), []).append(details)
    # Unknown fields come first: a missing field is often there by another name.
    unknown = (field for field, failures in by_field.items() if failures[0]["type"] == "extra_forbidden")
    field = next(unknown, next(iter(by_field)))
    deepest = max(len(details["loc"]) for details in by_field[field])  # of a union, the members it nearly fits
    failures = [details for details in by_field[field] if len(details["loc"]) == deepest]
    first = failures[0]
    match first["type"]:
        case "extra_forbidden":
            what = "table" if _is_table(first["input"]) else "field"
            return f"{field}: unknown {what}{_hint(first, schema)}"
        case "list_type" if isinstance(first["input"], dict) and field in LISTS:
            return f"{field}: is one table, [{field}]; expected a list of them, each beginning with [[{field}]]"
        case "missing":
            return f"{field}: is missing"
        case "value_error":
            message = first["msg"].removeprefix("Value error, ")
            return f"{field}.{message}" if field else message
    expected = " or ".join(dict.fromkeys(_expected(details) for details in failures))
    return f"{field}: must be {expected} (got {_shown(first['input'])})"


def _field(details: ErrorDetails, schema: type[BaseModel]) -> str:
    """Write the dotted path of the wrong field: Pydantic's location less the members of unions that it names too."""
    return ".".join(_walk(details, schema)[0])


def _walk(details: ErrorDetails, schema: type[BaseModel]) -> tuple[list[str], type[BaseModel]]:
    """Walk the steps of the path, to the last table on it that the schema knows."""
    steps: list[str] = []
    table, keys = schema, 0
    for place, step in enumerate(details["loc"]):
        unknown = details["type"] == "extra_forbidden" and place == len(details["loc"]) - 1
        if isinstance(step, int) or unknown or keys:
            steps.append(_shortened(str(step)))
            keys = max(keys - 1, 0)
        elif step in table.model_fields:
            steps.append(step)
            annotation = table.model_fields[step].annotation
            table, keys = table_in(annotation) or table, _key_count(annotation)
    return steps, table


def _is_table(value: object) -> bool:
    """Return whether a value is a table, or a list of tables."""
    return isinstance(value[0] if isinstance(value, list) and value else value, dict)


def _hint(details: ErrorDetails, schema: type[BaseModel]) -> str:
    """Find the known field that was probably meant, or all that are known there.

    It is of the same name elsewhere, near by if it is, or of a similar name there. A table is taken for another table
    only.
    """
    name, (steps, table) = str(details["loc"][-1]), _walk(details, schema)
    only_tables = _is_table(details["input"])
    if (meant := ALSO_CALLED.get(name, name.removesuffix("s"))) in table.model_fields:
        return ask([meant])

    def paths_of(is_meant: Callable[[str], bool]) -> list[str]:
        return [*_paths_of(schema, is_meant, only_tables)]

    paths = paths_of(lambda field: field == name)
    if near := [path for path in paths if path.split(".")[0] == steps[0]] or paths:
        return ask(near)
    alike = closest(name, dict.fromkeys(path.split(".")[-1] for path in paths_of(lambda field: True)))
    here = [field for field in alike if field in table.model_fields]
    anywhere = paths_of(lambda field: field in alike)
    if here or 0 < len(anywhere) <= MOST_ASKED:
        return ask(here or anywhere)
    return did_you_mean(name, table.model_fields) or f"; known here are {', '.join(table.model_fields)}"


def _paths_of(table: type[BaseModel], is_meant: Callable[[str], bool], only_tables: bool) -> Iterator[str]:
    """Find the paths of all fields of such a name, in a table and those within it."""
    for field, info in table.model_fields.items():
        inner = table_in(info.annotation)
        if is_meant(field) and (inner or not only_tables):
            yield field
        if inner:
            yield from (f"{field}.{path}" for path in _paths_of(inner, is_meant, only_tables))


def _key_count(annotation: object) -> int:
    """Return the number of nested keys in a field that the schema does not know."""
    arguments = typing.get_args(annotation)
    return 1 + _key_count(arguments[1]) if typing.get_origin(annotation) is dict else 0


def _expected(details: ErrorDetails) -> str:
    """Return the end of "must be ..." for a sentence of Pydantic."""
    message = details["msg"]
    if details.get("ctx", {}).get("ge") == TINY:
        return "greater than 0" if float(details["input"]) <= 0.0 else f"at least {TINY:g}"
    for opening, replacement in (
        ("Input should be a valid dictionary", "a table"),
        ("Input should be a valid tuple", "numbers in brackets"),
        ("Input should be an instance of PolygonMesh", "a PolygonMesh"),
        ("Input is not a valid path", "a path"),
        ("List should have at least 1 item", "a list of at least one item"),
    ):
        if message.startswith(opening):
            return replacement
    expected = re.split(", (?:unable|got) ", message.removeprefix("Input should be "), maxsplit=1)[0]
    return {"True": "true", "False": "false"}.get(expected, expected)


def _shown(value: object) -> str:
    return _shortened(repr(value))


def _shortened(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."


def toml_value(value: Any) -> str:
    """Write a truth value, number, text, list or table. Every number has all its digits."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, Mapping) and not value:
        return "{}"
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(name)} = {toml_value(inner)}" for name, inner in value.items()) + " }"
    if isinstance(value, Sequence):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    raise TypeError(f"TOML has no {type(value).__name__}")


def _key(name: str) -> str:
    """Return a TOML key, bare where it is a word; dots would split it."""
    return name if name.isascii() and name.isidentifier() else _quoted(name)


def _quoted(text: str) -> str:
    escapes = {'"': '\\"', "\\": "\\\\"}
    escaped = (escapes.get(c, c if c.isprintable() else f"\\U{ord(c):08x}") for c in text)
    return '"' + "".join(escaped) + '"'

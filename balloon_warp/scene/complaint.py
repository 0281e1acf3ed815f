"""A validation error in one sentence: which field, what was found, what was expected."""

import difflib
import types
import typing

from pydantic import BaseModel, ValidationError


def complaint(error: ValidationError, schema: type[BaseModel]) -> str:
    """The most telling of the errors, as "field: expected (got value)"."""
    first = min(error.errors(), key=lambda e: -len(e["loc"]) if e["type"] == "extra_forbidden" else -len(e["loc"]) - 1)
    steps = [str(step) for step in first["loc"] if _is_field_or_index(step)]
    field = ".".join(steps)
    more = error.error_count() - 1
    match first["type"]:
        case "extra_forbidden":
            known = _fields_at(schema, steps[:-1])
            close = difflib.get_close_matches(steps[-1], known, n=1)
            hint = f"did you mean {close[0]}?" if close else f"known here: {', '.join(known)}"
            return f"{field}: unknown field; {hint}"
        case "missing":
            return f"{field}: is missing"
        case "value_error":
            return first["msg"].removeprefix("Value error, ") if not field else f"{field}.{first['msg'][13:]}"
    message = first["msg"][0].lower() + first["msg"][1:]
    return f"{field}: {message} (got {_shown(first['input'])})" + (f", and {more} more" if more > 4 else "")


def _is_field_or_index(step: int | str) -> bool:
    """Pydantic also names the member of a union that it tried; those are no part of the path."""
    return isinstance(step, int) or step.isidentifier() and step not in ("float", "int", "str", "list", "tuple", "path")


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _fields_at(schema: type[BaseModel], steps: list[str]) -> list[str]:
    """Names of the fields of the table at a path."""
    table = schema
    for step in steps:
        if not step.isdecimal():
            table = _table_in(table.model_fields[step].annotation) or table
    return list(table.model_fields)


def _table_in(annotation: object) -> type[BaseModel] | None:
    if (
        isinstance(annotation, type)
        and not isinstance(annotation, types.GenericAlias)
        and issubclass(annotation, BaseModel)
    ):
        return annotation
    return next((found for part in typing.get_args(annotation) if (found := _table_in(part))), None)

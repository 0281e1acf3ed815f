"""Descriptions of a table's fields for help() and the pages: meaning and accepted values."""

import inspect
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from balloon_warp.kernels.laws.law import FAR, TINY
from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene.nesting import table_in
from balloon_warp.scene.toml import toml_value
from balloon_warp.shown import FieldHelp, docstrings, plain_docstring

Tables = type[BaseModel]


def meaning_of(table: Tables, field: str) -> str:
    """Return a field's meaning on one line, with its unit; for a nested table, the first line of its docstring."""
    said = table.model_fields[field].description or docstrings(table).get(field)
    inner = table_in(table.model_fields[field].annotation)
    return " ".join((said or (first_line(inner) if inner else "")).split())


def first_line(table: Tables) -> str:
    """Return the first line of a table's docstring."""
    return inspect.cleandoc(plain_docstring(table)).partition("\n")[0]


def fields_of(table: Tables) -> Iterator[FieldHelp]:
    """Describe a table's fields for help()."""
    properties = table.model_json_schema(schema_generator=PlainSchema)["properties"]
    for field, info in table.model_fields.items():
        default = ", required" if info.is_required() else f" = {info.default!r}"
        inner, takes = table_in(info.annotation), taken(properties[field]).replace("`", "")
        if inner:
            takes = f"list of {inner.__name__}" if takes.startswith("list") else inner.__name__
        yield FieldHelp(f"{field}{default} ({takes})" if takes else f"{field}{default}", meaning_of(table, field))


class PlainSchema(GenerateJsonSchema):
    """Make a JSON schema without the types that fields accept from Python alone."""

    def is_instance_schema(self, schema: core_schema.IsInstanceSchema) -> JsonSchemaValue:
        return {"type": "null"}


def taken(schema: dict[str, Any], several: bool = False) -> str:
    """Describe in words the values that a field accepts, from its JSON schema.

    Args:
        several: whether it is one of several alike.
    """
    if schema.get("$ref", "").endswith(f"/{PolygonMesh.__name__}"):
        return ""
    if "anyOf" in schema:
        return " or ".join(dict.fromkeys(said for each in schema["anyOf"] if (said := taken(each, several))))
    if choices := schema.get("enum", [schema["const"]] if "const" in schema else None):
        return " or ".join(f"`{toml_value(choice)}`" for choice in choices)
    match schema.get("type", "object"):
        case "null":
            return ""
        case "array" if items := schema.get("prefixItems"):
            if all(item == items[0] for item in items):
                return f"{len(items)} {taken(items[0], several=True)}"
            return f"[{', '.join(map(taken, items))}]"
        case "array":
            return f"list of {taken(schema['items'], several=True)}"
        case "boolean":
            return "`true` or `false`"
        case "string":
            return "file" if schema.get("format") == "path" else "text"
        case "number" | "integer" as kind:
            return f"{'whole ' * (kind == 'integer')}number{'s' * several}{_bounds(schema)}"
    return "tables" if several else "table"


def _bounds(schema: dict[str, Any]) -> str:
    least, most = schema.get("minimum", -FAR), schema.get("maximum", FAR)
    if least > -FAR and most < FAR:
        return f" from {least:,g} to {most:,g}"
    if least == TINY:
        return " > 0"
    return f" ≥ {least:,g}" if least > -FAR else ""

"""Every field of a scene file, with its unit, default and bounds: python -m balloon_warp.scene.reference

The tests hold docs/SCENE.md to this.
"""

import inspect
import typing
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from balloon_warp.kernels.laws.law import FAR, TINY
from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene.nesting import table_in
from balloon_warp.scene.schema import Scene
from balloon_warp.scene.toml import toml_value
from balloon_warp.shown import FieldHelp, docstrings, plain_docstring

Tables = type[BaseModel]


def meaning_of(table: Tables, field: str) -> str:
    """What a field of a table is, with its unit, on one line; of a table within it, the first line of that one's."""
    said = table.model_fields[field].description or docstrings(table).get(field)
    inner = table_in(table.model_fields[field].annotation)
    return " ".join((said or (first_line(inner) if inner else "")).split())


def default_of(table: Tables, field: str) -> str:
    """What a field is where a file does not say it, as TOML; empty where it must be said, or is nothing then."""
    info = table.model_fields[field]
    if info.is_required() or info.default in (None, "", [], {}) or isinstance(info.default, BaseModel):
        return ""
    return toml_value(info.default)


def first_line(table: Tables) -> str:
    """What a table is."""
    return inspect.cleandoc(plain_docstring(table)).partition("\n")[0]


def fields_of(table: Tables) -> Iterator[FieldHelp]:
    """What help() says of a table's fields."""
    properties = table.model_json_schema(schema_generator=_Schema)["properties"]
    for field, info in table.model_fields.items():
        default = ", must be given" if info.is_required() else f" = {info.default!r}"
        inner, taken = table_in(info.annotation), _taken(properties[field]).replace("`", "")
        if inner:
            taken = f"list of {inner.__name__}" if taken.startswith("list") else inner.__name__
        yield FieldHelp(f"{field}{default} ({taken})" if taken else f"{field}{default}", meaning_of(table, field))


def tables(table: Tables = Scene, path: str = "") -> Iterator[tuple[str, Tables]]:
    """A table and all that it holds, each with its heading in a file; of the scene itself, that is empty."""
    yield path and (f"[[{path}]]" if path in LISTS else f"[{path}]"), table
    for field, info in table.model_fields.items():
        if inner := table_in(info.annotation):
            yield from tables(inner, f"{path}.{field}" if path else field)


LISTS = {name for name, info in Scene.model_fields.items() if typing.get_origin(info.annotation) is list}
"""fields of the scene of which there may be several"""


class _Schema(GenerateJsonSchema):
    """With nothing of what fields take from Python alone."""

    def is_instance_schema(self, schema: core_schema.IsInstanceSchema) -> JsonSchemaValue:
        return {"type": "null"}


def as_markdown() -> str:
    """The page's tables, each with its heading."""
    return "\n\n".join(_section(heading, table) for heading, table in tables())


def _section(heading: str, table: Tables) -> str:
    properties = table.model_json_schema(schema_generator=_Schema)["properties"]
    lines = [f"## {f'`{heading}`' if heading else 'At the top'}", "", inspect.cleandoc(plain_docstring(table)), ""]
    lines += ["| field | takes | default | |", "|---|---|---|---|"]
    for field in table.model_fields:
        default = f"`{default_of(table, field)}`".replace("``", "-")
        default = "must be given" if table.model_fields[field].is_required() else default
        said = meaning_of(table, field).replace("|", "\\|")
        lines.append(f"| `{field}` | {_taken(properties[field])} | {default} | {said} |")
    return "\n".join(lines)


def _taken(schema: dict[str, Any], several: bool = False) -> str:
    """What a field takes, in words, from its JSON schema.

    Args:
        several: whether it is one of several alike.
    """
    if schema.get("$ref", "").endswith(f"/{PolygonMesh.__name__}"):
        return ""
    if "anyOf" in schema:
        return " or ".join(dict.fromkeys(taken for each in schema["anyOf"] if (taken := _taken(each, several))))
    if choices := schema.get("enum", [schema["const"]] if "const" in schema else None):
        return " or ".join(f"`{toml_value(choice)}`" for choice in choices)
    match schema.get("type", "object"):
        case "null":
            return ""
        case "array" if items := schema.get("prefixItems"):
            if all(item == items[0] for item in items):
                return f"{len(items)} {_taken(items[0], several=True)}"
            return f"[{', '.join(map(_taken, items))}]"
        case "array":
            return f"list of {_taken(schema['items'], several=True)}"
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


def main() -> None:
    """Print the tables."""
    print(as_markdown())


if __name__ == "__main__":
    main()

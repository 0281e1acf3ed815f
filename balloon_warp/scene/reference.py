"""Every field of a scene file, with its unit, default and bounds: python -m balloon_warp.scene.reference

The tests hold docs/SCENE.md to this.
"""

import ast
import inspect
import itertools
import textwrap
import typing
from collections.abc import Iterator
from functools import cache
from threading import Lock
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from balloon_warp.kernels.laws.law import FAR, TINY
from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene.nesting import table_in
from balloon_warp.scene.schema import Scene
from balloon_warp.scene.toml import toml_value

Tables = type[BaseModel]
PARSING = Lock()
"""Python 3.11 fails where two threads parse at once, as when two recordings are written"""


def meaning_of(table: Tables, field: str) -> str:
    """What a field of a table is, with its unit, on one line; of a table within it, the first line of that one's."""
    said = table.model_fields[field].description or _docstrings(table).get(field)
    inner = table_in(table.model_fields[field].annotation)
    return " ".join((said or (first_line(inner) if inner else "")).split())


@cache
def _docstrings(table: Tables) -> dict[str, str]:
    """Of the fields, as they stand below them in the source. Pydantic would read it for each process that has scenes,
    which takes it as long as to load them."""
    with PARSING:
        (definition,) = ast.parse(textwrap.dedent(inspect.getsource(table))).body
    assert isinstance(definition, ast.ClassDef)
    said: dict[str, str] = {}
    for base in table.__bases__:  # fields that it has in common with others
        if issubclass(base, BaseModel) and base.model_fields:
            said |= _docstrings(base)
    for field, below in itertools.pairwise(definition.body):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(below, ast.Expr):
            said[field.target.id] = inspect.cleandoc(ast.literal_eval(below.value))
    return said


def default_of(table: Tables, field: str) -> str:
    """What a field is where a file does not say it, as TOML; empty where it must be said, or is nothing then."""
    info = table.model_fields[field]
    if info.is_required() or info.default in (None, "", [], {}) or isinstance(info.default, BaseModel):
        return ""
    return toml_value(info.default)


def first_line(table: Tables) -> str:
    """What a table is."""
    return inspect.cleandoc(table.__doc__ or "").partition("\n")[0]


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
    lines = [f"## {f'`{heading}`' if heading else 'At the top'}", "", inspect.cleandoc(table.__doc__ or ""), ""]
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

"""Every field of a scene file, with its unit, default and bounds.

`python -m balloon_warp.scene.reference` prints them.

The tests hold docs/SCENE.md to this.
"""

import inspect
import typing
from collections.abc import Iterator

from pydantic import BaseModel

from balloon_warp.scene.complaint import table_in, toml_value
from balloon_warp.scene.schema import Scene
from balloon_warp.scene.schema.fields import PlainSchema, meaning_of, taken
from balloon_warp.system.shown import plain_docstring

Tables = type[BaseModel]


def default_of(table: Tables, field: str) -> str:
    """Write the default of a field, as TOML; empty where the field is required, or its default is empty or a table."""
    info = table.model_fields[field]
    if info.is_required() or info.default in (None, "", [], {}) or isinstance(info.default, BaseModel):
        return ""
    return toml_value(info.default)


def tables(table: Tables = Scene, path: str = "") -> Iterator[tuple[str, Tables]]:
    """List a table and all that it holds, each with its heading in a file; of the scene itself, that is empty."""
    yield path and (f"[[{path}]]" if path in LISTS else f"[{path}]"), table
    for field, info in table.model_fields.items():
        if inner := table_in(info.annotation):
            yield from tables(inner, f"{path}.{field}" if path else field)


LISTS = {name for name, info in Scene.model_fields.items() if typing.get_origin(info.annotation) is list}
"""Fields of the scene that are lists of tables"""


def as_markdown() -> str:
    """Write the page's tables, each with its heading."""
    return "\n\n".join(_section(heading, table) for heading, table in tables())


def _section(heading: str, table: Tables) -> str:
    properties = table.model_json_schema(schema_generator=PlainSchema)["properties"]
    lines = [f"## {f'`{heading}`' if heading else 'Top level'}", "", inspect.cleandoc(plain_docstring(table)), ""]
    lines += ["| field | meaning | takes | default |", "|---|---|---|---|"]
    for field in table.model_fields:
        default = f"`{default_of(table, field)}`".replace("``", "-")
        default = "required" if table.model_fields[field].is_required() else default
        said = meaning_of(table, field).replace("|", "\\|")
        lines.append(f"| `{field}` | {said} | {taken(properties[field])} | {default} |")
    return "\n".join(lines)


def main() -> None:
    """Print the tables."""
    print(as_markdown())


if __name__ == "__main__":
    main()

"""Every field of a scene file, with its unit, default and bounds, and the docstrings below fields that editors show.

`python -m balloon_warp.scene.reference` prints the tables of docs/SCENE.md; with `--docstrings` it writes docstrings
below the fields that lack them, or have stale ones. The tests hold both to this.

A law's parameter has its meaning and default in its row, and a table its meaning in its class.
"""

import ast
import inspect
import sys
import textwrap
import typing
from collections.abc import Iterator
from pathlib import Path

from pydantic import BaseModel

from balloon_warp.scene.fields import PlainSchema, Tables, meaning_of, table_in, taken, toml_value
from balloon_warp.scene.scene import Scene
from balloon_warp.system.api import docstrings, plain_docstring


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


WIDTH = 120
"""Width of a line [characters]"""
INDENT = " " * 4


def unsaid() -> Iterator[tuple[Tables, str, str]]:
    """Return tables, fields whose docstrings below them lack the meaning, and the meaning."""
    for table in dict.fromkeys(table for _, table in tables()):
        for field in vars(table).get("__annotations__", {}):
            if field in table.model_fields:
                said, meaning = " ".join(docstrings(table).get(field, "").split()), meaning_of(table, field)
                of_row = table.model_fields[field].description and default_of(table, field)
                wanted = f"{meaning}; {of_row} when missing" if of_row else meaning
                if said != wanted:
                    yield table, field, wanted


def write_docstrings() -> None:
    """Write the missing docstrings."""
    for table, field, meaning in list(unsaid()):
        path = Path(inspect.getfile(table))
        lines = path.read_text(encoding="utf-8").splitlines()
        (place,) = (
            (line.end_lineno or 0, below)
            for named in ast.walk(ast.parse("\n".join(lines)))
            if isinstance(named, ast.ClassDef) and named.name == table.__name__
            for line, below in zip(named.body, [*named.body[1:], None], strict=True)
            if isinstance(line, ast.AnnAssign) and ast.unparse(line.target) == field
        )
        end, below = place
        is_said = isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
        lines[end : below.end_lineno if is_said and below else end] = as_docstring(meaning)
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        sys.stdout.write(f"{path.name}: {table.__name__}.{field}\n")


def as_docstring(meaning: str) -> list[str]:
    """Return the lines of a docstring."""
    text = f'"""{meaning}{" " * meaning.endswith(chr(34))}"""'
    return textwrap.wrap(
        text, WIDTH, initial_indent=INDENT, subsequent_indent=INDENT, break_on_hyphens=False, break_long_words=False
    )


def main() -> None:
    """Print the tables; with `--docstrings`, write the docstrings that are missing."""
    if sys.argv[1:] == ["--docstrings"]:
        write_docstrings()
    else:
        print(as_markdown())


if __name__ == "__main__":
    main()

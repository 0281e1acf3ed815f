"""Docstrings below the fields of tables, which editors show.

`python -m balloon_warp.scene.hover` writes them.

A law's parameter has its meaning and default in its row, and a table its meaning in its class. This module writes both
below the fields that take them, where they are missing or stale. The tests hold the schema to this.
"""

import ast
import inspect
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

from balloon_warp.scene.reference import default_of, tables
from balloon_warp.scene.schema.fields import Tables, meaning_of
from balloon_warp.system.shown import docstrings

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


def main() -> None:
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


if __name__ == "__main__":
    main()

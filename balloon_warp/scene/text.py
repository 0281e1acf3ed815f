"""A scene as text: its file, every field with unit, default and bounds, and the docstrings that editors show.

`python -m balloon_warp.scene.text` prints the tables of docs/SCENE.md; with `--docstrings` it writes docstrings below
the fields that lack them, or have stale ones. The tests hold both to this.

A law's parameter has its meaning and default in its row, and a table its meaning in its class.
"""

import ast
import inspect
import os
import shutil
import sys
import textwrap
import typing
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from balloon_warp.errors import InputError
from balloon_warp.scene.balloon import Balloon
from balloon_warp.scene.fields import PlainSchema, Tables, first_line, meaning_of, table_in, taken, toml_value
from balloon_warp.scene.load import bundled_scenes, files_of, files_of_scene, with_files
from balloon_warp.scene.scene import MESHED, WITHOUT_MESHES, Body, Obstacle, Scene
from balloon_warp.system.api import docstrings, plain_docstring
from balloon_warp.system.files import check_writable, marked_scene, replaces_any, require_ours, whole_file


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


HEADER = """\
# A scene: balloon-warp run THIS_FILE simulates it. SI units. A field that is left out has its default.
# python -m balloon_warp.scene.text lists every field.
"""
LONGEST_COMMENT = 100
"""Largest number of characters of a comment beside a value; a longer one stands above it"""


def write_scene(scene: Scene, path: Path) -> list[Path]:
    """Write a scene as a file that runs wherever it is taken with the files beside it; return the files written.

    Meshes and prints of bundled scenes are copied beside it. Others are named from where it is.

    Raises:
        InputError: a file cannot be written, a scene is there that somebody edited, or another mesh is where one is to
            be copied to.
    """
    check_writable(path, (".toml",))
    require_ours(path)
    files = dict.fromkeys(Path(os.path.abspath(file)) for file in files_of_scene(scene))
    copies = {mesh: path.parent / mesh.name for mesh in files if _is_bundled(mesh)}
    missing = {mesh: copy for mesh, copy in copies.items() if not _is_copied(mesh, copy)}
    moved = {
        name: [
            with_files(each, {field: copies.get(file, file) for field, file in _files_of(each).items()})
            for each in getattr(scene, name)
        ]
        for name in MESHED
    }
    for mesh, copy in missing.items():
        with whole_file(copy) as temporary:
            shutil.copyfile(mesh, temporary)
    with whole_file(path) as temporary:
        text = scene_toml(scene.model_copy(update=moved), path.parent)
        temporary.write_text(marked_scene(text), encoding="utf-8")
    return [path, *missing.values()]


def scene_toml(scene: Scene, folder: Path) -> str:
    """Write the scene as a TOML file in `folder` would say it, with each field's meaning, but without defaults.

    Mesh files are named from the folder, those of bundled scenes by their whole path. Every number has all its digits.
    """
    table = scene.model_dump(mode="json", exclude_defaults=True, exclude=WITHOUT_MESHES)
    if "atmosphere" in table:
        table["atmosphere"] = {k: v for k, v in table["atmosphere"].items() if k not in scene.atmosphere.following}
    for name in MESHED:
        for number, each in enumerate(getattr(scene, name)):
            files = {field: _named_from(file, folder) for field, file in _files_of(each).items()}
            table[name][number] = _with_files_named(table[name][number], files)
    return HEADER + "\n".join(_lines(scene, table)) + "\n"


def _with_files_named(table: dict[str, Any], files: dict[str, str]) -> dict[str, Any]:
    """Return the table with its files, and those of nested tables, first."""
    own = {field: file for field, file in files.items() if "." not in field}
    table = own | {field: value for field, value in table.items() if field not in own}
    for path in files.keys() - own.keys():
        within, _, field = path.partition(".")
        table[within] = {field: files[path]} | {k: v for k, v in table[within].items() if k != field}
    return table


def _files_of(meshed: Balloon | Body | Obstacle) -> dict[str, Path]:
    """Return the files of a table's mesh and print, by the fields that name them."""
    named = {"mesh": meshed.mesh} | files_of(meshed)
    return {field: Path(os.path.abspath(str(file))) for field, file in named.items() if file is not None}


def _is_bundled(mesh: Path) -> bool:
    return mesh.parent in {scene.parent for scene in bundled_scenes().values()}


def _is_copied(mesh: Path, copy: Path) -> bool:
    """Return whether a copy exists already.

    Raises:
        InputError: something else is.
    """
    if not os.path.lexists(copy):
        return False
    if copy.is_file() and copy.read_bytes() == mesh.read_bytes():
        return True
    if replaces_any():
        return False
    raise InputError(
        f"{copy}: already exists and differs from the scene's file of that name; expected another folder, or --force"
    )


def _named_from(mesh: Path, folder: Path) -> str:
    """Name a mesh as a file in a folder does, so that both can be moved together."""
    if not _is_bundled(mesh) or mesh.parent == Path(os.path.abspath(folder)):
        with suppress(ValueError):  # another drive
            return Path(os.path.relpath(os.path.realpath(mesh.parent), os.path.realpath(folder)), mesh.name).as_posix()
    return str(mesh)


def _lines(said: BaseModel, dump: dict[str, Any], path: str = "") -> list[str]:
    """Write the lines of a table: its values, and then the tables within it.

    Args:
        said: the table.
        dump: its written part.
        path: of the table in the scene, with a dot at its end.
    """
    values: dict[str, str] = {}
    within: list[str] = []
    for field, value in dump.items():
        held = getattr(said, field)
        parts = held if isinstance(held, list) else [held]
        if parts and all(isinstance(part, BaseModel) for part in parts):
            heading = f"[[{path}{field}]]" if isinstance(held, list) else f"[{path}{field}]"
            for part, inner in zip(parts, value if isinstance(held, list) else [value], strict=True):
                within += ["", f"{heading}  # {first_line(type(part))}", *_lines(part, inner, f"{path}{field}.")]
        else:
            values[field] = f"{field} = {toml_value(value)}"
    width = max((len(line) for line in values.values() if len(line) < LONGEST_COMMENT // 2), default=0)
    lines = []
    for field, line in values.items():
        default = default_of(type(said), field)
        comment = "; ".join(filter(None, (meaning_of(type(said), field), default and f"default {default}")))
        if len(comment) > LONGEST_COMMENT:
            lines += [f"# {part}" for part in textwrap.wrap(comment, LONGEST_COMMENT)]
            comment = ""
        lines.append(f"{line:{width}}  # {comment}" if comment else line)
    return lines + within


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

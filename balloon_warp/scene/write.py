"""Writing of a scene as a file."""

import os
import shutil
import textwrap
from contextlib import suppress
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from balloon_warp.errors import InputError
from balloon_warp.scene.balloon import Balloon
from balloon_warp.scene.fields import first_line, meaning_of, toml_value
from balloon_warp.scene.load import bundled_scenes, files_of, files_of_scene, with_files
from balloon_warp.scene.reference import default_of
from balloon_warp.scene.scene import MESHED, WITHOUT_MESHES, Body, Obstacle, Scene
from balloon_warp.system.files import check_writable, marked_scene, replaces_any, require_ours, whole_file

HEADER = """\
# A scene: balloon-warp run THIS_FILE simulates it. SI units. A field that is left out has its default.
# python -m balloon_warp.scene.reference lists every field.
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

"""From a scene back to its file."""

import os
import shutil
import textwrap
from contextlib import suppress
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from balloon_warp.errors import InputError
from balloon_warp.files import check_writable, whole_file
from balloon_warp.scene.load import bundled_scenes
from balloon_warp.scene.reference import default_of, first_line, meaning_of
from balloon_warp.scene.schema import MESHED, WITHOUT_MESHES, Balloon, Body, Obstacle, Scene
from balloon_warp.scene.toml import toml_value

HEADER = """\
# A scene: balloon-warp run THIS_FILE simulates it. SI units. A field that is left out has its default.
# python -m balloon_warp.scene.reference lists every field.
"""
LONGEST_COMMENT = 100
"""characters that stand beside a value; a longer comment stands above it"""


def write_scene(scene: Scene, path: Path) -> list[Path]:
    """Write a scene as a file that runs wherever it is taken with what is beside it; returns the files written.

    Meshes of bundled scenes are copied beside it. Others are named from where it is.

    Raises:
        InputError: a file cannot be written, or another mesh is where one is to be copied to.
    """
    check_writable(path, (".toml",))
    copies = {mesh: path.parent / mesh.name for mesh in dict.fromkeys(_meshes(scene)) if _is_bundled(mesh)}
    missing = {mesh: copy for mesh, copy in copies.items() if not _is_copied(mesh, copy)}
    moved = {
        name: [
            each.model_copy(update={"mesh": copies.get(mesh, mesh)}) if (mesh := _path_of(each)) else each
            for each in getattr(scene, name)
        ]
        for name in MESHED
    }
    for mesh, copy in missing.items():
        with whole_file(copy) as temporary:
            shutil.copyfile(mesh, temporary)
    with whole_file(path) as temporary:
        temporary.write_text(scene_toml(scene.model_copy(update=moved), path.parent), encoding="utf-8")
    return [path, *missing.values()]


def scene_toml(scene: Scene, folder: Path) -> str:
    """The scene as a TOML file in `folder` would say it, with what each field is; what has its default is left out.

    Mesh files are named from the folder, those of bundled scenes by their whole path. Every number has all its digits.
    """
    table = scene.model_dump(mode="json", exclude_defaults=True, exclude=WITHOUT_MESHES)
    for name in MESHED:
        for number, each in enumerate(getattr(scene, name)):
            if mesh := _path_of(each):
                table[name][number] = {"mesh": _named_from(mesh, folder), **table[name][number]}
    return HEADER + "\n".join(_lines(scene, table)) + "\n"


def _meshes(scene: Scene) -> list[Path]:
    paths = (_path_of(each) for name in MESHED for each in getattr(scene, name))
    return [path for path in paths if path]


def _path_of(meshed: Balloon | Body | Obstacle) -> Path | None:
    """The file of its mesh."""
    return None if meshed.mesh is None else Path(os.path.abspath(str(meshed.mesh)))


def _is_bundled(mesh: Path) -> bool:
    return mesh.parent in {scene.parent for scene in bundled_scenes().values()}


def _is_copied(mesh: Path, copy: Path) -> bool:
    """Whether a copy is there already.

    Raises:
        InputError: something else is.
    """
    if not os.path.lexists(copy):
        return False
    if copy.is_file() and copy.read_bytes() == mesh.read_bytes():
        return True
    raise InputError(f"{copy}: is there already, and is not the scene's mesh of that name; expected another folder")


def _named_from(mesh: Path, folder: Path) -> str:
    """A mesh as a file in a folder names it, so that both can be moved together."""
    if not _is_bundled(mesh) or mesh.parent == Path(os.path.abspath(folder)):
        with suppress(ValueError):  # another drive
            return Path(os.path.relpath(os.path.realpath(mesh.parent), os.path.realpath(folder)), mesh.name).as_posix()
    return str(mesh)


def _lines(said: BaseModel, dump: dict[str, Any], path: str = "") -> list[str]:
    """The lines of a table: its values, and then the tables within it.

    Args:
        said: the table.
        dump: what of it is written.
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

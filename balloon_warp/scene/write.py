"""From a scene back to its file."""

import os
from pathlib import Path
from typing import Any

from balloon_warp.scene.schema import Scene


def scene_toml(scene: Scene, folder: Path) -> str:
    """The scene as a TOML file in `folder` would say it; what has its default is left out.

    Mesh files are named from the folder where they are below it, and by their whole path elsewhere. Every number has
    all its digits.
    """
    table = scene.model_dump(mode="json", exclude_defaults=True, exclude={"balloon": {"__all__": {"mesh"}}})
    base = Path(os.path.abspath(folder))
    for number, balloon in enumerate(scene.balloon):
        mesh = Path(os.path.abspath(str(balloon.mesh)))
        place = mesh.relative_to(base) if mesh.is_relative_to(base) else mesh
        table["balloon"][number] = {"mesh": str(place), **table["balloon"][number]}
    lines = [f"{name} = {_value(value)}" for name, value in table.items() if not _is_table(value)]
    for name, value in table.items():
        for part in value if isinstance(value, list) else [value]:
            if _is_table(value):
                lines += ["", f"[[{name}]]" if isinstance(value, list) else f"[{name}]"]
                lines += [f"{field} = {_value(inner)}" for field, inner in part.items()]
    return "\n".join(lines) + "\n"


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and isinstance(value[0], dict))


def _value(value: Any) -> str:
    """One value, as TOML writes it in a line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(name)} = {_value(inner)}" for name, inner in value.items()) + " }"
    return "[" + ", ".join(_value(item) for item in value) + "]"


def _key(name: str) -> str:
    """Bare where it is a word; dots would part it."""
    return name if name.isascii() and name.isidentifier() else _quoted(name)


def _quoted(text: str) -> str:
    escapes = {'"': '\\"', "\\": "\\\\"}
    escaped = (escapes.get(c, c if c.isprintable() else f"\\U{ord(c):08x}") for c in text)
    return '"' + "".join(escaped) + '"'

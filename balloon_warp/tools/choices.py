"""Values to compare, parsed from the command line."""

import re
from pathlib import Path
from typing import Any

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene.load import find_mesh, parse_value

RANGE = r"[-+.\deE]+:[-+.\deE]+"
"""Pattern of ranges, as `batch` takes them"""
_OPENING, _CLOSING, _QUOTES = "[{", "]}", "\"'"


def parse_choices(text: str, scene_source: str = "") -> tuple[str, list[Any]]:
    """Split `PATH=VALUE,VALUE,...`; each value is read as in `--set`. Commas in brackets and quotes do not split.

    Args:
        text: argument of `--vary`.
        scene_source: the scene that the command names; meshes are sought beside its file, too.

    Raises:
        InputError: there is no path, no `=`, an empty value, or a range.
    """
    path, _, words = (part.strip() for part in text.partition("="))
    values = [word.strip() for word in _split(words)]
    if len(values) == 1 and re.fullmatch(RANGE, values[0]):
        raise InputError(
            f"--vary {text}: takes values, as in --vary {path}={values[0].replace(':', ',')}; ranges are for `batch`"
        )
    if not all(path.split(".")) or not all(values):
        raise InputError(
            f"--vary {text}: expected PATH=VALUE,VALUE,..., as in --vary normals=cached,fresh or "
            "--vary balloon.inflation.k_normal=1,2,4"
        )
    if path.split(".")[-1] == "mesh":
        return path, [find_mesh(value, scene_source) for value in values]
    return path, [parse_value(value) for value in values]


def shown(value: Any) -> str:
    """Show a value as a label or a table does: a mesh by its name."""
    if isinstance(value, float):
        return f"{value:g}"
    return value.name if isinstance(value, Path | PolygonMesh) else str(value)


def _split(words: str) -> list[str]:
    """Split at commas that are in neither brackets nor quotes."""
    parts, depth, quote = [""], 0, ""
    for letter in words:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in _QUOTES:
            quote = letter
        else:
            depth += (letter in _OPENING) - (letter in _CLOSING)
        if letter == "," and not quote and depth <= 0:
            parts.append("")
        else:
            parts[-1] += letter
    return parts

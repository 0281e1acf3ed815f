"""Outlines of letters, in a font that Matplotlib brings with it or that the machine has."""

from pathlib import Path
from typing import Any

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.foil.necks import with_necks
from balloon_warp.foil.outlines import enclosed, from_extra

FONT = "DejaVu Sans"
"""Font that Matplotlib brings with it; bold"""
FONT_SUFFIXES = (".ttf", ".otf", ".ttc")
FINE = 100.0
"""Factor on the size at which Matplotlib divides the curves of letters finely"""


def outlines_of_text(text: str, font: str | None = None) -> list[Any]:
    """Return polygons of Shapely's of a line of text, from left to right, one for each letter with its dot.

    Args:
        font: a file, or the name of a family of the machine's.

    Raises:
        InputError: the text has nothing to be seen, or there is no such font, or it lacks a character.
        MissingExtraError: Matplotlib or Shapely is not installed.
    """
    line = "".join(" " if character.isspace() else character for character in text)
    if not line.strip():
        raise InputError(f"text: has no visible character (got {text!r}); expected letters, or an .svg file")
    properties, face = _font(font)
    for character in line.replace(" ", ""):
        if not face.get_char_index(ord(character)):
            raise InputError(f"text: the font {face.family_name} has no {character!r}; expected another font")
    path = from_extra("matplotlib.path").Path
    paths = from_extra("matplotlib.textpath").TextToPath()
    vertices, codes = paths.get_text_path(properties, line, ismath=False)
    loops = path(FINE * np.asarray(vertices), codes).to_polygons(closed_only=True) if len(vertices) else []
    outlines = with_necks(enclosed([np.asarray(loop) for loop in loops]))
    if not outlines:
        raise InputError(f"text: its characters have no outlines in the font {face.family_name} (got {text!r})")
    return outlines


def _font(font: str | None) -> tuple[Any, Any]:
    """Return a font as Matplotlib asks for it, and its face."""
    manager = from_extra("matplotlib.font_manager")
    path = font or FONT
    is_file = path.lower().endswith(FONT_SUFFIXES)
    if is_file and not Path(path).is_file():
        raise InputError(f"font {path}: no such file")
    try:
        if not is_file:
            wanted = manager.FontProperties(family=path, weight="bold")
            path = str(manager.findfont(wanted, fallback_to_default=False))
        return manager.FontProperties(fname=path), manager.get_font(path)
    except ValueError:
        raise InputError(
            f"font {font}: no such font family; expected an installed one, or a file of {', '.join(FONT_SUFFIXES)}"
        ) from None
    except (RuntimeError, OSError):
        raise InputError(f"font {font}: cannot be read as a font") from None

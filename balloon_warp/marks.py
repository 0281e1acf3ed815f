"""Marks by which the program knows the files that it made.

A stage has its mark in its metadata, a scene in its first line, with a hash of the others, a folder in its manifest,
and any other file, such as a picture, in a comment at its begin.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from PIL.PngImagePlugin import PngInfo

PROGRAM = "Balloon Warp"
LINE = f"Written by {PROGRAM}"
"""Comment at the begin of a text file"""
MANIFEST = {"written_by": PROGRAM}
"""Entry of a folder's manifest, as JSON"""
STAGE_KEY = "balloonWarp"
"""Key in the `customLayerData` of a stage"""
STAGES = (".usd", ".usda", ".usdc")
HEAD_BYTES = 1024
"""Largest size of a file's head up to the end of its mark [bytes]"""


def is_ours(path: Path) -> bool:
    """Return whether a file has our mark, and, if it is a scene, nobody edited it since."""
    try:
        if path.suffix.lower() in STAGES:
            return path.is_file() and _is_our_stage(path)
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
            return _is_unedited(head + file.read()) if path.suffix.lower() == ".toml" else PROGRAM.encode() in head
    except OSError:
        return False


def marked_scene(text: str) -> str:
    """Return the text of a scene's file, behind a line by which `is_ours` sees whether it was edited."""
    return f"{_first_line(text.encode())}\n{text}"


def png_mark() -> "PngInfo":
    """Return the mark of a PNG file, as Pillow's `save` takes it for `pnginfo`."""
    from PIL.PngImagePlugin import PngInfo  # only where there is a picture

    mark = PngInfo()
    mark.add_text("Software", PROGRAM)
    return mark


def manifest_text(manifest: Mapping[str, Any]) -> str:
    """Return the text of a folder's manifest, with its mark."""
    return json.dumps({**MANIFEST, **manifest}, indent=1) + "\n"


def without_mark(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a manifest that was read, without its mark."""
    return {name: value for name, value in manifest.items() if name not in MANIFEST}


def _is_our_stage(path: Path) -> bool:
    from pxr import Sdf, Tf  # loads USD: only where a stage is in the way

    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(path), metadataOnly=True)
    except Tf.ErrorException:
        return False
    return layer is not None and STAGE_KEY in layer.customLayerData


def _first_line(below: bytes) -> str:
    return f"# {LINE}, which may replace this file until it is edited: {hashlib.sha256(below).hexdigest()[:16]}"


def _is_unedited(content: bytes) -> bool:
    first, _, below = content.partition(b"\n")
    return first == _first_line(below).encode()

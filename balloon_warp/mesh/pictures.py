"""Images that meshes name, made sure of: one that is missing or no image is a sentence, and no reason to fail."""

import hashlib
import io
import re
from pathlib import Path, PurePosixPath, PureWindowsPath

from balloon_warp.mesh.looks import Look, Picture

LARGEST_FILE = 1 << 28
"""Largest size of an image [bytes]"""
KEPT = {"PNG": ".png", "JPEG": ".jpg"}
"""Suffixes of images that stay as they are, by their format; others become PNG"""


class Pictures:
    """Cache of the images that a mesh names, each read once."""

    def __init__(self, source: Path | str):
        self._source = source
        self._read: dict[str, Picture | None] = {}
        self.warnings: list[str] = []
        """Warnings, one for each image that cannot be read or placed"""

    def of_file(self, named: str, folder: Path) -> Picture | None:
        """Read the image of a file.

        Args:
            named: as a mesh names it: from its folder, or, where there is none, its bare name there.
            folder: of the mesh.
        """
        path = beside(folder, named)
        if path is None:
            return self._missing(named)
        if path.stat().st_size > LARGEST_FILE:
            return self.of_bytes(named, b"")
        try:
            return self.of_bytes(named, path.read_bytes(), path)
        except OSError:
            return self.of_bytes(named, b"")

    def of_bytes(self, named: str, data: bytes | None, file: Path | None = None) -> Picture | None:
        """Read the image of a file's content.

        Args:
            data: None where there is no such file.
            file: that it is of, if it is one of its own.
        """
        if data is None:
            return self._missing(named)
        if named not in self._read:
            self._read[named] = _picture(named, data, file)
            if self._read[named] is None:
                self.warnings.append(f"{self._source}: its texture {named} cannot be read as an image; it is left out.")
        return self._read[named]

    def mean_of(self, look: Look, named: str) -> Look:
        """Return a look with the mean color of its image, where the mesh does not say how the image lies on it."""
        if look.picture is None:
            return look
        sentence = f"{self._source}: its texture {named} has no coordinates on the mesh; its mean color is taken."
        if sentence not in self.warnings:
            self.warnings.append(sentence)
        return look.plain

    def _missing(self, named: str) -> None:
        if named not in self._read:
            self._read[named] = None
            self.warnings.append(f"{self._source}: its texture {named} is missing; it is left out.")


def beside(folder: Path, named: str) -> Path | None:
    """Find the regular file of a name in a mesh, from the mesh's folder; else that of its bare name there."""
    for name in (named, named.replace("\\", "/"), PureWindowsPath(named).name, PurePosixPath(named).name):
        try:
            if name and (path := folder / name).is_file():
                return path
        except (OSError, ValueError):  # too long for a name, or with a zero in it
            continue
    return None


def _picture(named: str, data: bytes, file: Path | None) -> Picture | None:
    """Decode an image, or return None if it is none."""
    from PIL import Image, UnidentifiedImageError  # only for a mesh that has images

    try:
        with Image.open(io.BytesIO(data)) as image:
            suffix = KEPT.get(image.format or "")
            if suffix is None or image.mode not in ("RGB", "RGBA", "L", "P"):
                deep = image.mode.startswith("I")  # gray in 16 bits
                shown = image.convert("I").point(lambda value: value / 257).convert("L") if deep else image
                with io.BytesIO() as packed:
                    shown.convert("RGB").save(packed, "PNG")
                    suffix, data = KEPT["PNG"], packed.getvalue()
            else:
                image.load()  # to the end: a truncated one would fail once all is done
    except (OSError, ValueError, SyntaxError, UnidentifiedImageError, Image.DecompressionBombError):
        return None
    bare = re.sub(r"[^0-9A-Za-z_-]+", "_", PurePosixPath(named.replace("\\", "/")).stem).strip("_")[:40] or "texture"
    mark = f"_{hashlib.sha256(data).hexdigest()[:8]}"
    return Picture(f"{bare.removesuffix(mark)}{mark}{suffix}", data, file)

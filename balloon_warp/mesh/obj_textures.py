"""Texture coordinates of an OBJ file, which go along with a balloon and do nothing else."""

from array import array

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.check import FLOAT32_MAX

NOWHERE = -(2**31)
"""Number at the corners of a face that has none"""


class ObjTextures:
    """Collect `vt` lines and faces' references to them.

    Where they make no sense there are none: no mesh is refused for its texture.
    """

    def __init__(self) -> None:
        self._coordinates, self._corners = array("d"), array("i")
        self._complete = True
        self._before = 0
        """Number of corners of faces without any, before the first that has some"""

    def add_vertex(self, words: list[bytes]) -> None:
        """Add a `vt` line: u, and v unless it is 0; a depth may follow."""
        try:
            self._coordinates.extend((float(words[0]), float(words[1]) if len(words) > 1 else 0.0))
        except (IndexError, ValueError):
            self._complete = False

    def add_face(self, words: list[bytes]) -> None:
        """Add the corners of an `f` line: v/vt or v/vt/vn."""
        if not self._corners and b"/" not in words[0]:
            self._before += len(words)
        elif self._complete:
            self._add_corners(words)

    def _add_corners(self, words: list[bytes]) -> None:
        above = len(self._coordinates) // 2
        if all(b"/" not in word or b"//" in word for word in words):
            self._corners.extend(array("i", [NOWHERE]) * len(words))
            return
        try:
            numbers = [int(word.split(b"/", 2)[1]) for word in words]
            self._corners.extend(number - 1 if number >= 0 else above + number for number in numbers)
        except (IndexError, ValueError, OverflowError):
            self._complete = False

    def of_corners(self, partly: bool = False) -> NDArray[np.float32] | None:
        """Return u and v at the corners of all faces, shape (corner_count, 2); None unless all corners have them.

        Args:
            partly: Whether faces may have none, so that zeros stand there.
        """
        coordinates = np.frombuffer(self._coordinates).reshape(-1, 2)
        if not (self._complete and self._corners and len(coordinates)) or (self._before and not partly):
            return None
        corners = np.concatenate([np.full(self._before, NOWHERE), np.frombuffer(self._corners, dtype=np.int32)])
        nowhere = (corners == NOWHERE) & partly
        there = (nowhere | (corners >= 0) & (corners < len(coordinates))).all()
        if not there or not (np.abs(coordinates) <= FLOAT32_MAX).all():
            return None
        return np.where(nowhere[:, None], 0.0, coordinates[np.where(nowhere, 0, corners)]).astype(np.float32)

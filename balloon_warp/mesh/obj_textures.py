"""Texture coordinates of an OBJ file, which go along with a balloon and do nothing else."""

from array import array

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.check import FLOAT32_MAX


class ObjTextures:
    """Collects `vt` lines and what faces name of them. Where they make no sense there are none: no mesh is refused for
    its texture."""

    def __init__(self) -> None:
        self._coordinates, self._corners = array("d"), array("i")
        self._complete = True

    def add_vertex(self, words: list[bytes]) -> None:
        """A `vt` line: u, and v unless it is 0; a depth may follow."""
        try:
            self._coordinates.extend((float(words[0]), float(words[1]) if len(words) > 1 else 0.0))
        except (IndexError, ValueError):
            self._complete = False

    def add_face(self, words: list[bytes]) -> None:
        """The corners of an `f` line: v/vt or v/vt/vn."""
        if not self._complete:
            return
        above = len(self._coordinates) // 2
        try:
            numbers = [int(word.split(b"/", 2)[1]) for word in words]
            self._corners.extend(number - 1 if number >= 0 else above + number for number in numbers)
        except (IndexError, ValueError, OverflowError):
            self._complete = False

    def of_corners(self) -> NDArray[np.float32] | None:
        """u and v at the corners of all faces, shape (corner_count, 2); None unless all corners have them."""
        coordinates = np.frombuffer(self._coordinates).reshape(-1, 2)
        corners = np.frombuffer(self._corners, dtype=np.int32)
        there = self._complete and ((corners >= 0) & (corners < len(coordinates))).all()
        if not there or not (np.abs(coordinates) <= FLOAT32_MAX).all():
            return None
        return coordinates.astype(np.float32)[corners]

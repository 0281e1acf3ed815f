"""The groups of an OBJ file, `g` and `o` lines: names for the vertices of the faces that follow."""

from array import array
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

MOST_GROUPS = 10_000
"""Largest number of names that are kept of a file"""


class ObjGroups:
    """Collects `g` and `o` lines. A face is in the groups of the last `g` line, and in the object of the last `o`."""

    def __init__(self) -> None:
        self._ranges: dict[str, array[int]] = {}
        """Begin and end of runs of faces, by name"""
        self._open: dict[bytes, tuple[list[str], int]] = {}
        """Current names, and the first face that has them, by `g` or `o`"""

    def begin(self, kind: bytes, text: bytes, face: int) -> None:
        """Begin a group: a line with its names, and the number of the next face."""
        self._end(kind, face)
        words = text.split() if kind == b"g" else [text.strip()]
        self._open[kind] = [word.decode("utf-8", "replace") for word in words if word], face

    def of_vertices(self, sizes: NDArray[np.int32], corners: NDArray[np.int32]) -> dict[str, NDArray[np.int32]]:
        """Return the vertices of each group, ascending.

        Args:
            sizes: of all faces.
            corners: of all faces, one after the other.
        """
        for kind in list(self._open):
            self._end(kind, len(sizes))
        ends = np.concatenate([[0], np.cumsum(sizes)])
        groups = {}
        for name, ranges in self._ranges.items():
            runs = [corners[ends[begin] : ends[end]] for begin, end in zip(ranges[::2], ranges[1::2], strict=True)]
            groups[name] = np.unique(np.concatenate(runs))
        return groups

    def faces_of(self, names: Iterable[str], face_count: int) -> NDArray[np.bool_]:
        """Return a mask of the faces that are in a group of these names."""
        mask = np.zeros(face_count, bool)
        for name in names:
            ranges = self._ranges[name]
            for begin, end in zip(ranges[::2], ranges[1::2], strict=True):
                mask[begin:end] = True
        return mask

    def _end(self, kind: bytes, face: int) -> None:
        names, begin = self._open.pop(kind, ([], face))
        for name in names if face > begin else ():
            if name in self._ranges or len(self._ranges) < MOST_GROUPS:
                self._ranges.setdefault(name, array("i")).extend((begin, face))

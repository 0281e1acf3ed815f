"""Arrays of a glTF file: its buffers, as its JSON lays them out."""

import base64
import binascii
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.files import check_regular, regular_content

LARGEST = {5120: 127, 5121: 255, 5122: 32767, 5123: 65535}
"""Integers that stand for 1 in normalized accessors, by component type"""
KINDS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
MOST_NUMBERS = 1 << 28
"""Largest count of numbers in an array"""


class GltfBuffers:
    """Buffers of a glTF file, each read once.

    Args:
        path: of the file, beside which others are.
        tree: its JSON, to which new arrays are added.
        binary: the binary chunk of a GLB.
    """

    def __init__(self, path: Path, tree: dict[str, Any], binary: bytes):
        self._folder, self._tree, self._binary = path.parent, tree, binary
        self._read: dict[int, bytes] = {}

    def view(self, number: Any) -> bytes:
        """Return the bytes of a buffer view.

        Raises:
            LookupError, TypeError, ValueError, AttributeError, InputError: it is not there.
        """
        view = self._tree["bufferViews"][number]
        begin = view.get("byteOffset", 0)
        return self._buffer(view["buffer"])[begin : begin + view["byteLength"]]

    def array(self, number: Any) -> NDArray[np.float64]:
        """Return an accessor's numbers, shape (count, width); normalized integers as their fractions.

        Raises:
            LookupError, TypeError, ValueError, AttributeError, InputError: it is not there, or is larger than its view.
        """
        accessor = self._tree["accessors"][number]
        count, width, kind = accessor["count"], WIDTHS[accessor["type"]], KINDS[accessor["componentType"]]
        if not 0 <= count * width <= MOST_NUMBERS:
            raise ValueError(f"accessor {number} has {count} items")
        values = np.zeros((count, width), kind)
        if "bufferView" in accessor:
            values = self._rows(accessor, accessor["bufferView"], count, width, kind)
        if sparse := accessor.get("sparse"):
            where, what = sparse["indices"], sparse["values"]
            rows = self._rows(where, where["bufferView"], sparse["count"], 1, KINDS[where["componentType"]])
            values = values.copy()
            values[rows[:, 0].astype(np.int64)] = self._rows(what, what["bufferView"], sparse["count"], width, kind)
        numbers = values.astype(np.float64)
        if accessor.get("normalized") and accessor["componentType"] in LARGEST:
            numbers = np.maximum(numbers / LARGEST[accessor["componentType"]], -1.0)
        return numbers

    def add(self, points: NDArray[np.floating]) -> int:
        """Add an array of vectors to the file, and return its accessor's number."""
        data = np.ascontiguousarray(points, np.float32).tobytes()
        uri = f"data:application/octet-stream;base64,{base64.b64encode(data).decode()}"
        self._tree.setdefault("buffers", []).append({"byteLength": len(data), "uri": uri})
        views, accessors = self._tree.setdefault("bufferViews", []), self._tree.setdefault("accessors", [])
        views.append({"buffer": len(self._tree["buffers"]) - 1, "byteLength": len(data)})
        accessors.append({"bufferView": len(views) - 1, "componentType": 5126, "count": len(points), "type": "VEC3"})
        return len(accessors) - 1

    def check(self) -> None:
        """Make sure that the files which the buffers name may be read.

        Raises:
            InputError: one is missing, is no regular file, or is too large.
        """
        buffers = self._tree.get("buffers")
        for buffer in buffers if isinstance(buffers, list) else []:
            uri = buffer.get("uri") if isinstance(buffer, dict) else None
            if isinstance(uri, str) and not uri.startswith("data:"):
                check_regular(self._folder / unquote(uri))

    def _buffer(self, number: int) -> bytes:
        if number not in self._read:
            uri = self._tree["buffers"][number].get("uri")
            if uri is None:
                return self._binary
            if uri.startswith("data:"):
                self._read[number] = decoded(uri)
            else:
                self._read[number] = regular_content(self._folder / unquote(uri))
        return self._read[number]

    def _rows(self, said: dict[str, Any], view: int, count: int, width: int, kind: Any) -> NDArray[Any]:
        """Return the rows of a view from an offset on, each after its stride."""
        data, size = self.view(view), np.dtype(kind).itemsize * width
        stride, begin = self._tree["bufferViews"][view].get("byteStride", size), said.get("byteOffset", 0)
        if count and not (size <= stride and 0 <= begin <= begin + (count - 1) * stride + size <= len(data)):
            raise ValueError(f"its buffer view {view} is too short")
        if not count:
            return np.zeros((0, width), kind)
        taken = np.frombuffer(data, np.uint8, (count - 1) * stride + size, begin)
        rows = np.lib.stride_tricks.as_strided(taken, (count, size), (stride, 1), writeable=False)
        return np.ascontiguousarray(rows).view(kind)


def decoded(uri: str) -> bytes:
    """Return the content of a data URI; nothing where it is none."""
    try:
        return base64.b64decode(uri.partition(",")[2])
    except (binascii.Error, ValueError):
        return b""


BROKEN = (LookupError, TypeError, ValueError, AttributeError, OverflowError, InputError)
"""Errors of reading an array where the file does not fit together"""

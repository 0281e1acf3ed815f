"""The container of a .glb file: arrays, their description in JSON, and the packing of both."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

VERTICES, CORNERS = 34962, 34963
"""Targets of an array, as glTF numbers them: a vertex's attributes, and the corners of triangles"""
_COMPONENTS = {np.dtype(np.float32): 5126, np.dtype(np.uint32): 5125}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


class GlbBuffer:
    """Arrays of one binary buffer, in the order in which they are added."""

    def __init__(self) -> None:
        self.accessors: list[dict[str, Any]] = []
        self._views: list[dict[str, Any]] = []
        self._chunks: list[bytes] = []
        self._length = 0

    def add(self, array: NDArray, target: int | None = None, bounded: bool = False) -> int:
        """Add float32 or uint32 numbers, shape (n,) or (n, 2 to 4), and get the number of their accessor.

        Args:
            target: `VERTICES`, `CORNERS` or neither.
            bounded: whether least and most are said, as glTF wants of positions and times.
        """
        data = np.ascontiguousarray(array)
        view: dict[str, Any] = {"buffer": 0, "byteOffset": self._length, "byteLength": data.nbytes}
        if target is not None:
            view["target"] = target
        columns = data.reshape(len(data), -1)
        accessor: dict[str, Any] = {
            "bufferView": len(self._views),
            "componentType": _COMPONENTS[data.dtype],
            "count": len(data),
            "type": _TYPES[columns.shape[1]],
        }
        if bounded:
            accessor |= {"min": columns.min(axis=0).tolist(), "max": columns.max(axis=0).tolist()}
        self._views.append(view)
        self.accessors.append(accessor)
        self._chunks.append(data.tobytes())  # of 4 bytes each: all stay aligned
        self._length += data.nbytes
        return len(self.accessors) - 1

    def add_bytes(self, data: bytes) -> int:
        """Add bytes that are no array, such as an image's file, and get the number of their view."""
        self._views.append({"buffer": 0, "byteOffset": self._length, "byteLength": len(data)})
        self._chunks.append(data + b"\0" * (-len(data) % 4))
        self._length += len(self._chunks[-1])
        return len(self._views) - 1

    def write(self, path: Path, content: dict[str, Any]) -> None:
        """Write the file: the glTF document, with these arrays."""
        said = content | {
            "accessors": self.accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": self._length}],
        }
        text = json.dumps(said, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        with path.open("wb") as file:
            file.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + self._length))
            file.write(struct.pack("<I4s", len(text), b"JSON") + text)
            file.write(struct.pack("<I4s", self._length, b"BIN\0"))
            file.writelines(self._chunks)

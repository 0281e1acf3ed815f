"""Contents of the file of a world."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

AXES = {"axis": 3, "quaternion": 4}
"""Dimensions of vectors, and their lengths"""
Attribute = int | float | str


@dataclass(frozen=True)
class Field:
    """An array of a file."""

    name: str
    dimensions: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: str
    """Type as NumPy writes it: "<f4" """
    unit: str
    meaning: str

    @property
    def bytes(self) -> int:
        return int(np.prod(self.shape, dtype=np.int64)) * np.dtype(self.dtype).itemsize

    @property
    def bytes_of_frame(self) -> int:
        """Size of one frame, where the first dimension is time."""
        return self.bytes // self.shape[0]

    def as_json(self) -> dict[str, Any]:
        """Describe the field for a manifest."""
        return {"dimensions": self.dimensions, "dtype": self.dtype, "unit": self.unit, "is": self.meaning}


Arrays = Sequence[tuple[Field, NDArray]]
"""Arrays of a file, with their descriptions"""


@dataclass(frozen=True)
class WorldFile:
    """Contents of a world's file, but for its frames."""

    attributes: Mapping[str, Attribute]
    static: Arrays
    """Fields that stay, and are kept once for all worlds that have them in common"""
    times: Arrays
    """Fields that have as many rows as there are frames, and are known before"""
    moving: Sequence[Field]


@dataclass(frozen=True)
class FileContents:
    """Description of a whole file."""

    attributes: Mapping[str, Attribute]
    arrays: Arrays
    elsewhere: Sequence[str] = ()
    """Names of the arrays that stand in another file, at `static` of the attributes from the folder above"""

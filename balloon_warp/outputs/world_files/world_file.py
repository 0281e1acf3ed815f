"""Contents of the file of a world."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

AXES = {"axis": 3, "quaternion": 4}
"""Dimensions of vectors, and their lengths"""


@dataclass(frozen=True)
class Field:
    """An array of a world's file."""

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


@dataclass(frozen=True)
class WorldFile:
    """Contents of a world's file: attributes, arrays that stay, and arrays that move."""

    attributes: Mapping[str, int | float | str]
    fixed: Sequence[tuple[Field, NDArray]]
    moving: Sequence[Field]


class Slot(NamedTuple):
    """Place of an array in a file."""

    path: Path
    offset: int


def own_attributes(world: WorldFile, like: WorldFile) -> dict[str, Any]:
    """Return the attributes in which a world differs from another with the same arrays."""
    return {name: value for name, value in world.attributes.items() if value != like.attributes[name]}

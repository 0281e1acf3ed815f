"""Frames of a world as they come, in any order: an array after the other in a file of nothing else."""

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.outputs.world_files.world_file import Arrays, Field

SUFFIX = ".frames"


def make_room(path: Path, moving: Sequence[Field]) -> None:
    """Create the file, with room for all frames."""
    with path.open("wb") as file:
        file.truncate(sum(field.bytes for field in moving))


def put_frames(path: Path, moving: Sequence[Field], begin: int, frames: Mapping[str, NDArray]) -> None:
    """Write frames that follow each other, from one on, of each array."""
    descriptor = os.open(path, os.O_WRONLY)
    try:
        for field, room in _places(moving):
            offset, left = room + begin * field.bytes_of_frame, np.ascontiguousarray(frames[field.name]).data.cast("B")
            while left:
                written = os.pwrite(descriptor, left, offset)
                left, offset = left[written:], offset + written
    finally:
        os.close(descriptor)


def all_frames(path: Path, moving: Sequence[Field]) -> Arrays:
    """Return all frames of each array, which are read where they are looked at."""
    return [(field, np.memmap(path, field.dtype, "r", offset, field.shape)) for field, offset in _places(moving)]


def _places(moving: Sequence[Field]) -> Iterator[tuple[Field, int]]:
    """Find where each array begins."""
    offset = 0
    for field in moving:
        yield field, offset
        offset += field.bytes

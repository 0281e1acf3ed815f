"""Point caches of Blender's Mesh Cache modifier: the PC2 format, which grows while Blender plays it."""

import os
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

HEADER = struct.Struct("<12siiffi")
"""Signature, version, number of points, first frame, frames a sample, number of samples"""
SIGNATURE = b"POINTCACHE2\0"


class PointCache:
    """Points of one object, a sample a frame.

    A sample counts once all of it is in the file, so that a reader sees whole frames, also after a kill.

    Args:
        path: of the file; one that has this number of points goes on growing, anything else is replaced.
        point_count: Number of points in a sample.

    Raises:
        OSError: the file cannot be written.
    """

    def __init__(self, path: Path, point_count: int):
        self.path, self.point_count = path, point_count
        self.sample_count = samples_of(path, point_count)
        self._file = path.open("r+b" if self.sample_count else "w+b")
        if not self.sample_count:
            self._write_header()

    def write(self, number: int, points: NDArray[np.float32]) -> None:
        """Write a sample; those after it count no more.

        Args:
            number: of the sample, at most that of all before it.
            points: shape (point_count, 3), in the object's own axes and units.

        Raises:
            OSError: the file cannot be written.
        """
        sample = np.ascontiguousarray(points, dtype="<f4")
        if sample.shape != (self.point_count, 3) or number > self.sample_count:
            raise ValueError(f"{self.path}: sample {number} of {sample.shape} after {self.sample_count}")
        self._file.seek(HEADER.size + number * sample.nbytes)
        self._file.write(sample.tobytes())
        self._file.flush()
        self.sample_count = number + 1
        self._write_header()

    def sync(self) -> None:
        """Wait until all samples are safe on the disk."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _write_header(self) -> None:
        self._file.seek(0)
        self._file.write(HEADER.pack(SIGNATURE, 1, self.point_count, 0.0, 1.0, self.sample_count))
        self._file.flush()


def samples_of(path: Path, point_count: int) -> int:
    """Return the number of samples of a cache with so many points; 0 where the file is another or none."""
    try:
        with path.open("rb") as file:
            header = file.read(HEADER.size)
    except FileNotFoundError:
        return 0
    if len(header) < HEADER.size or HEADER.unpack(header)[:3] != (SIGNATURE, 1, point_count):
        return 0
    return HEADER.unpack(header)[5]

"""Files of a world each, with all that moved in it, for learning: NumPy's, HDF5 by h5py, and Zarr, which needs nothing.

Frames may come in any order, and the same frames give the same bytes.
"""

import json
import os
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.system.arrays import PACKED, NamedArrays, require_h5py, write_npz

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


LEVEL = 1
"""Level of compression: higher ones take several times as long, for a few hundredths of the size"""
SAMPLE, WORTH_IT = 2**14, 0.9
"""Number of bytes that are tried, and the part of their size to which they must shrink"""
CHUNK_BYTES = 2**19
"""Largest size of a piece of several rows: readers keep one of at most 1 MiB in memory"""


def chunk_shape(field: Field) -> tuple[int, ...]:
    """Return the shape of a field's pieces, whole rows of it."""
    rows = max(1, min(field.shape[0], CHUNK_BYTES // max(field.bytes_of_frame, 1)))
    return (rows, *field.shape[1:])


def chunks_of(field: Field, values: NDArray) -> Iterator[NDArray]:
    """Cut an array into its pieces; the last is filled up with zeros."""
    shape = chunk_shape(field)
    for begin in range(0, field.shape[0], shape[0]):
        piece = np.ascontiguousarray(values[begin : begin + shape[0]], dtype=field.dtype)
        if len(piece) < shape[0]:
            piece = np.concatenate([piece, np.zeros((shape[0] - len(piece), *shape[1:]), dtype=field.dtype)])
        yield piece


def packed(piece: NDArray) -> bytes:
    """Compress a piece: the first bytes of all its numbers, the second ones and so on, which are alike.

    The last digits of measurements are noise, on which most of the time would go: bytes that do not shrink are copied.
    """
    planes = np.ascontiguousarray(piece.reshape(-1).view(np.uint8).reshape(-1, piece.itemsize).T)
    parts, checksum = [b"\x78\x01"], zlib.adler32(planes.data)  # a stream of zlib, block by block
    for left, plane in zip(reversed(range(piece.itemsize)), planes, strict=True):
        middle = len(plane) // 2
        sample = plane[middle : middle + SAMPLE].data
        shrinks = len(zlib.compress(sample, LEVEL)) < WORTH_IT * len(sample)
        packer = zlib.compressobj(LEVEL if shrinks else 0, zlib.DEFLATED, -zlib.MAX_WBITS)
        parts += [packer.compress(plane.data), packer.flush(zlib.Z_FULL_FLUSH if left else zlib.Z_FINISH)]
    return b"".join([*parts, checksum.to_bytes(4, "big")])


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


class Npz:
    """NumPy's .npz."""

    suffix = ".npz"

    def write(self, path: Path, contents: FileContents) -> None:
        """See `Format`."""
        attributes = np.array(json.dumps(dict(contents.attributes)))
        arrays = ((field.name, np.asarray(values)) for field, values in contents.arrays)
        write_npz(path, (*arrays, ("attributes", attributes)), LEVEL)


SMALL = 2**14
"""Size of arrays up to which the index of pieces would take more than compression saves"""


class Hdf5:
    """HDF5 files. Arrays of other files are links, which readers follow.

    Raises:
        MissingExtraError: h5py is not installed.
    """

    suffix = ".h5"

    def __init__(self) -> None:
        self._h5py = require_h5py()

    def write(self, path: Path, contents: FileContents) -> None:
        """See `Format`. h5py writes one thing at a time: pieces are compressed outside of it."""
        with self._h5py.File(path, "w") as file:
            file.attrs.update(contents.attributes)
            arrays = NamedArrays(file)
            for name in contents.elsewhere:
                file[name] = self._h5py.ExternalLink(f"../{contents.attributes['static']}", f"/{name}")
            for field, values in contents.arrays:
                if field.bytes <= SMALL:
                    arrays.add(field.name, values, field.dimensions, field.unit)
                    continue
                storage: dict[str, Any] = {"chunks": chunk_shape(field), **PACKED}
                data = arrays.room(field.name, field.shape, field.dimensions, field.unit, field.dtype, **storage)
                for number, piece in enumerate(chunks_of(field, values)):
                    place = (number * len(piece), *(0 for _ in field.shape[1:]))
                    data.id.write_direct_chunk(place, packed(piece))


class Zarr:
    """Zarr 2, which versions 2 and 3 of its library read, and xarray. It is written without them."""

    suffix = ".zarr"

    def write(self, path: Path, contents: FileContents) -> None:
        """See `Format`."""
        path.mkdir()
        for field, values in contents.arrays:
            (path / field.name).mkdir()
            for name, said in _array(field).items():
                (path / field.name / name).write_text(json.dumps(said), encoding="utf-8")
            for number, piece in enumerate(chunks_of(field, values)):
                name = ".".join([str(number), *("0" for _ in field.shape[1:])])
                (path / field.name / name).write_bytes(packed(piece))
        self._describe(path, contents)

    @staticmethod
    def _describe(path: Path, contents: FileContents) -> None:
        """Write the attributes, and the consolidated metadata of all arrays."""
        said: dict[str, Any] = {".zgroup": {"zarr_format": 2}, ".zattrs": dict(contents.attributes)}
        for name, value in said.items():
            (path / name).write_text(json.dumps(value), encoding="utf-8")
        for field, _ in contents.arrays:
            said |= {f"{field.name}/{name}": value for name, value in _array(field).items()}
        text = json.dumps({"zarr_consolidated_format": 1, "metadata": said})
        (path / ".zmetadata").write_text(text, encoding="utf-8")


def _array(field: Field) -> dict[str, Any]:
    """Describe an array, by the names of the files that do."""
    array = {
        "zarr_format": 2,
        "shape": field.shape,
        "chunks": chunk_shape(field),
        "dtype": field.dtype,
        "compressor": {"id": "zlib", "level": LEVEL},
        "fill_value": None,  # else readers take zeros for missing
        "order": "C",
        "filters": [{"id": "shuffle", "elementsize": int(field.dtype[-1])}],
    }
    return {".zarray": array, ".zattrs": {"_ARRAY_DIMENSIONS": field.dimensions, "units": field.unit}}


class Format(Protocol):
    """A format. Files of several worlds may be written at the same time."""

    suffix: str

    def write(self, path: Path, contents: FileContents) -> None:
        """Write a file."""
        ...


FORMATS: dict[str, type[Format]] = {"h5": Hdf5, "zarr": Zarr, "npz": Npz}


def format_named(name: str) -> type[Format]:
    """Return a format.

    Raises:
        InputError: there is none of that name.
        MissingExtraError: its package is not installed.
    """
    if name not in FORMATS:
        raise InputError(f"format {name}: expected {', '.join(FORMATS)}")
    FORMATS[name]()  # which says if a package is missing
    return FORMATS[name]


__all__ = ["FORMATS", "Field", "FileContents", "Format", "WorldFile", "format_named"]

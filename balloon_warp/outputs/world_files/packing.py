"""Arrays in pieces that are compressed by themselves, as HDF5 and Zarr have them: bytes shuffled, then zlib."""

import zlib
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from balloon_warp.outputs.world_files.world_file import Field

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

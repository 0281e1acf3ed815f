"""Reads and writes of memory without what Warp's own indexing allows for: strides, and indices from the end.

In a loop over a particle's springs, that would be most of the instructions.
"""

from typing import Any

import warp as wp


@wp.func_native("return array.data[(unsigned int)index];")
def int_at(array: wp.array[wp.int32], index: wp.int32) -> wp.int32:
    """`array[index]` of a contiguous array."""
    ...


@wp.func_native("return array.data[(unsigned int)index];")
def float_at(array: wp.array[float], index: wp.int32) -> float:
    """`array[index]` of a contiguous array."""
    ...


@wp.func_native("return array.data[(unsigned int)index];")
def vector_at(array: wp.array[wp.vec3], index: wp.int32) -> wp.vec3:
    """`array[index]` of a contiguous array."""
    ...


@wp.func_native("return array.data[(unsigned int)index];")
def triple_at(array: wp.array[wp.vec3i], index: wp.int32) -> wp.vec3i:
    """`array[index]` of a contiguous array."""
    ...


@wp.func
def in_tile(tile: Any, index: wp.int32):
    """`tile[index]`; tiles are contiguous as they are."""
    return tile[index]


@wp.func_native("tile.data.ptr[index] = value;")
def put_in_tile(tile: Any, index: wp.int32, value: Any):
    """Into a shared tile, without a barrier."""
    ...


@wp.func
def put_in_array(array: Any, index: wp.int32, value: Any):
    """Into an array."""
    array[index] = value

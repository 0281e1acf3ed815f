"""Elements of arrays that are contiguous, at indices that are not negative: one instruction for the address.

Warp's own indexing allows for strides and for indices from the end, in 64-bit arithmetic: in a loop over a particle's
springs, that is most of the instructions.
"""

from typing import Any

import warp as wp


@wp.func_native("return array.data[(unsigned int)index];")
def int_at(array: wp.array[wp.int32], index: wp.int32) -> wp.int32:
    """`array[index]`"""
    ...


@wp.func_native("return array.data[(unsigned int)index];")
def float_at(array: wp.array[float], index: wp.int32) -> float:
    """`array[index]`"""
    ...


@wp.func_native("return array.data[(unsigned int)index];")
def vector_at(array: wp.array[wp.vec3], index: wp.int32) -> wp.vec3:
    """`array[index]`"""
    ...


@wp.func
def vector_of_tile(tile: Any, index: wp.int32):
    """`tile[index]`; tiles are contiguous as they are."""
    return tile[index]

"""Views of single numbers of a model's arrays, with one value a world."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp


def columns_of(array: wp.array, index: Sequence[int | slice]) -> list[wp.array]:
    """Return the numbers at an index of each world's part of an array, a view of shape (world_count,) for each.

    Args:
        array: of floats or vectors of floats, whose first dimension is the world.
        index: into a world's part, with an axis for vectors; a slice stands for all of its dimension.
    """
    worlds, *shape = _number_shape(array)
    scalar = wp.float64 if array.dtype in (wp.float64, wp.vec3d, wp.mat33d) else wp.float32
    strides = [*array.strides, wp.types.type_size_in_bytes(scalar)][: 1 + len(shape)]
    places = np.arange(int(np.prod(shape, dtype=int))).reshape(shape)[tuple(index)]
    return [_column(array, scalar, worlds, strides, np.unravel_index(place, shape)) for place in np.ravel(places)]


def _number_shape(array: wp.array) -> tuple[int, ...]:
    """Return the shape of an array's numbers: those of vectors are a last dimension."""
    vector = getattr(array.dtype, "_shape_", ())
    return (*array.shape, *vector)


def _column(array: Any, scalar: Any, worlds: int, strides: Sequence[int], place: Sequence[Any]) -> wp.array:
    begin = array.ptr + sum(int(at) * stride for at, stride in zip(place, strides[1:], strict=True))
    view = wp.array(ptr=begin, dtype=scalar, shape=(worlds,), strides=(strides[0],), device=array.device)
    view._ref = array  # the memory stays as long as the view
    return view


def rows_of_words(array: Any) -> wp.array:
    """Return a contiguous array as rows of 32-bit words, or of bytes where they do not fill words."""
    row = array.strides[0]
    dtype = wp.uint32 if row % 4 == 0 else wp.uint8
    size = wp.types.type_size_in_bytes(dtype)
    shape = (array.shape[0], row // size)
    view = wp.array(ptr=array.ptr, dtype=dtype, shape=shape, device=array.device)
    view._ref = array
    return view


def component(array: wp.array, axis: int) -> Any:
    """Return a column of an array of shape (world_count, size), or an array of shape (world_count,) itself."""
    return array if array.ndim == 1 else array[:, axis]

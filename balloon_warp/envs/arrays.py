"""Arrays of an environment, as NumPy or torch has them."""

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, Literal

import numpy as np
import warp as wp

from balloon_warp.errors import InputError, MissingExtraError
from balloon_warp.steering.given import copy_given

Output = Literal["numpy", "torch"]


def output_of(output: Output) -> Callable[..., Any]:
    """Return the function that copies an array of the device into one of NumPy or torch.

    Raises:
        InputError: there is no such kind.
        MissingExtraError: torch is not installed.
    """
    if output not in ("numpy", "torch"):
        raise InputError(f'output: must be "numpy" or "torch" (got {output!r})')
    if output == "torch" and not find_spec("torch"):
        raise MissingExtraError('output = "torch" needs torch: pip install torch')
    return _as_numpy if output == "numpy" else _as_torch


def _as_numpy(array: wp.array, flags: bool = False) -> Any:
    values = np.asarray(array.numpy())
    return values != 0 if flags else values.copy()


def _as_torch(array: wp.array, flags: bool = False) -> Any:
    values = wp.to_torch(array)
    return values != 0 if flags else values.clone()


def actions_array(given: Any, like: wp.array) -> wp.array:
    """Return actions as an array of the device, of the shape of another.

    Raises:
        InputError: they have another shape, or are no numbers.
    """
    if isinstance(given, np.ndarray) and given.dtype.kind not in "fiub":
        raise InputError(f"actions: must be numbers (got an array of {given.dtype})")
    shape = tuple(np.shape(given) if not hasattr(given, "shape") else given.shape)
    if shape != tuple(like.shape):
        raise InputError(f"actions: expected shape {tuple(like.shape)} (got {shape})")
    taken = wp.empty_like(like)
    copy_given(taken, given, "actions")
    return taken

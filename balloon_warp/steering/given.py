"""Values that somebody gives for worlds: arrays of Warp, torch, JAX or NumPy, or numbers."""

from typing import Any

import numpy as np
import warp as wp

from balloon_warp.errors import InputError


def copy_given(target: wp.array, given: Any, path: str) -> None:
    """Copy values into an array of a device; values on that device already do not pass the host.

    Raises:
        InputError: they have another shape or are no numbers.
    """
    source = _on_device(given) if hasattr(given, "__dlpack__") and not isinstance(given, np.ndarray) else given
    if isinstance(source, wp.array):
        if source.dtype != target.dtype:
            source = wp.array(source.numpy(), dtype=target.dtype, device=target.device)
        _require_shape(tuple(source.shape), target, path)
        wp.copy(target, source)
        return
    try:
        values = np.asarray(source, dtype=wp.dtype_to_numpy(target.dtype))
    except (TypeError, ValueError):
        raise InputError(f"{path}: expected a number for each world (got {str(given)[:60]})") from None
    if values.ndim:
        _require_shape(values.shape, target, path)
    target.assign(np.broadcast_to(values, target.shape))


def _on_device(given: Any) -> Any:
    """Return the same memory as an array of Warp."""
    return (
        given if isinstance(given, wp.array) else wp.from_dlpack(given.detach() if hasattr(given, "detach") else given)
    )


def _require_shape(shape: tuple[int, ...], target: wp.array, path: str) -> None:
    if shape != tuple(target.shape):
        raise InputError(f"{path}: expected a value for each world, of shape {tuple(target.shape)} (got {shape})")

"""Arrays of an environment, as NumPy or torch has them."""

from importlib.util import find_spec
from typing import Any, Literal

import numpy as np
import warp as wp

from balloon_warp.envs.told import Layout, Told
from balloon_warp.errors import InputError, MissingExtraError
from balloon_warp.steering.given import copy_given

Output = Literal["numpy", "torch"]


class NumpyOutput:
    """Copies the results of a step to the host, at once and through pinned memory."""

    def __init__(self, layout: Layout, device: wp.Device):
        self._layout, self._device = layout, device
        self._host = wp.empty(layout.size, dtype=wp.int32, device="cpu", pinned=device.is_cuda)

    def __call__(self, block: wp.array) -> Told:
        """Return the results in a block."""
        wp.copy(self._host, block)
        if self._device.is_cuda:
            wp.synchronize_stream(self._device.stream)
        return self._layout.told(np.array(self._host.numpy()), np.float32)


class TorchOutput:
    """Copies the results of a step into torch's memory of the same device; the host does not wait."""

    def __init__(self, layout: Layout, device: wp.Device):
        self._layout = layout

    def __call__(self, block: wp.array) -> Told:
        """Return the results in a block."""
        import torch  # pyright: ignore[reportMissingImports]

        return self._layout.told(wp.to_torch(block).clone(), torch.float32)


def output_of(output: Output) -> type[NumpyOutput] | type[TorchOutput]:
    """Return the class that copies the results of a step into arrays of NumPy or torch.

    Raises:
        InputError: there is no such kind.
        MissingExtraError: torch is not installed.
    """
    if output not in ("numpy", "torch"):
        raise InputError(f'output: must be "numpy" or "torch" (got {output!r})')
    if output == "torch" and not find_spec("torch"):
        raise MissingExtraError('output = "torch" needs torch: pip install torch')
    return NumpyOutput if output == "numpy" else TorchOutput


def copy_actions(target: wp.array, given: Any) -> None:
    """Copy actions into an array of the device.

    Raises:
        InputError: they have another shape, or are no numbers.
    """
    if isinstance(given, np.ndarray) and given.dtype.kind not in "fiub":
        raise InputError(f"actions: must be numbers (got an array of {given.dtype})")
    shape = tuple(np.shape(given) if not hasattr(given, "shape") else given.shape)
    if shape != tuple(target.shape):
        raise InputError(f"actions: expected shape {tuple(target.shape)} (got {shape})")
    copy_given(target, given, "actions")

"""Arrays in an HDF5 group whose dimensions have names, as netCDF 4 has them, so that xarray knows them."""

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import MissingExtraError

NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable. "
"""Name by which netCDF 4 marks a dimension that has a length and no values"""


def require_h5py() -> Any:
    """Return the module.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        return import_module("h5py")
    except ImportError:
        raise MissingExtraError("an .h5 needs h5py: pip install 'balloon-warp[data]'") from None


class NamedArrays:
    """Writes arrays into a group of an HDF5 file, or into the file itself.

    Args:
        group: of h5py.
    """

    def __init__(self, group: Any):
        self.group = group
        self._dimensions: dict[str, Any] = {}

    def add(self, name: str, values: NDArray, dimensions: tuple[str, ...], unit: str) -> None:
        """Write an array; one that is named as a dimension has the dimension's values."""
        data = self.group.create_dataset(name, data=values)
        if name in dimensions:
            self._dimensions[name] = data
            data.make_scale(name)
        else:
            self._name(data, dimensions)
        data.attrs["units"] = unit

    def room(
        self, name: str, shape: tuple[int, ...], dimensions: tuple[str, ...], unit: str, dtype: Any, **storage: Any
    ) -> Any:
        """Create an array that is written later; `storage` is as of h5py's `create_dataset`."""
        data = self.group.create_dataset(name, shape, dtype, **storage)
        self._name(data, dimensions)
        data.attrs["units"] = unit
        return data

    def _name(self, data: Any, dimensions: tuple[str, ...]) -> None:
        for place, (name, length) in enumerate(zip(dimensions, data.shape, strict=True)):
            if name not in self._dimensions:
                scale = self.group.create_dataset(name, (length,), np.float32)
                scale.make_scale(f"{NO_VARIABLE}{length:10d}")
                self._dimensions[name] = scale
            data.dims[place].attach_scale(self._dimensions[name])

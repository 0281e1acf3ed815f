"""Arrays in an HDF5 group whose dimensions have labels: names without the arrays that netCDF 4 would add for them."""

from importlib import import_module
from typing import Any

from numpy.typing import NDArray

from balloon_warp.errors import MissingExtraError

PACKED = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
"""Options of h5py by which arrays are compressed, without loss, as every reader of HDF5 knows it"""


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

    def add(self, name: str, values: NDArray, dimensions: tuple[str, ...], unit: str) -> None:
        """Write an array."""
        self._label(self.group.create_dataset(name, data=values), dimensions, unit)

    def room(
        self, name: str, shape: tuple[int, ...], dimensions: tuple[str, ...], unit: str, dtype: Any, **storage: Any
    ) -> Any:
        """Create an array that is written later; `storage` is as of h5py's `create_dataset`."""
        data = self.group.create_dataset(name, shape, dtype, **storage)
        self._label(data, dimensions, unit)
        return data

    @staticmethod
    def _label(data: Any, dimensions: tuple[str, ...], unit: str) -> None:
        for dimension, name in zip(data.dims, dimensions, strict=True):
            dimension.label = name
        data.attrs["units"] = unit

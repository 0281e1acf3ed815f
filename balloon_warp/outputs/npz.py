"""Arrays in an .npz file, of which only one is in memory at a time."""

import zipfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


def write_npz(path: Path, arrays: Iterable[tuple[str, NDArray]], level: int = 0) -> None:
    """Write named arrays as they come; the same arrays give the same bytes.

    Args:
        level: of compression, 1 to 9, or 0 for none.
    """
    with zipfile.ZipFile(
        path, "w", zipfile.ZIP_DEFLATED if level else zipfile.ZIP_STORED, compresslevel=level
    ) as archive:
        for name, array in arrays:
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                if array.flags.c_contiguous and array.ndim and not array.dtype.hasobject:
                    np.lib.format.write_array_header_1_0(file, np.lib.format.header_data_from_array_1_0(array))
                    file.write(array.data.cast("B") if array.size else b"")  # in one piece, without a copy
                else:
                    np.lib.format.write_array(file, array, allow_pickle=False)

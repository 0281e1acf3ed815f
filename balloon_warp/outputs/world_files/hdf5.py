"""The file of a world as HDF5: flat, its dimensions labelled, and compressed as every reader of HDF5 knows it."""

from pathlib import Path
from typing import Any

from balloon_warp.outputs.hdf5_arrays import PACKED, NamedArrays, require_h5py
from balloon_warp.outputs.world_files.packing import chunk_shape, chunks_of, packed
from balloon_warp.outputs.world_files.world_file import FileContents

SMALL = 2**14
"""Size of arrays up to which the index of pieces would take more than compression saves"""


class Hdf5:
    """HDF5 files. Arrays of other files are links, which readers follow.

    Raises:
        MissingExtraError: h5py is not installed.
    """

    suffix = ".h5"

    def __init__(self) -> None:
        self._h5py = require_h5py()

    def write(self, path: Path, contents: FileContents) -> None:
        """See `Format`. h5py writes one thing at a time: pieces are compressed outside of it."""
        with self._h5py.File(path, "w") as file:
            file.attrs.update(contents.attributes)
            arrays = NamedArrays(file)
            for name in contents.elsewhere:
                file[name] = self._h5py.ExternalLink(f"../{contents.attributes['static']}", f"/{name}")
            for field, values in contents.arrays:
                if field.bytes <= SMALL:
                    arrays.add(field.name, values, field.dimensions, field.unit)
                    continue
                storage: dict[str, Any] = {"chunks": chunk_shape(field), **PACKED}
                data = arrays.room(field.name, field.shape, field.dimensions, field.unit, field.dtype, **storage)
                for number, piece in enumerate(chunks_of(field, values)):
                    place = (number * len(piece), *(0 for _ in field.shape[1:]))
                    data.id.write_direct_chunk(place, packed(piece))

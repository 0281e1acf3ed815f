"""The file of a world as HDF5: flat, each array in one piece, its dimensions named as netCDF 4 has them."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from balloon_warp.outputs.hdf5_arrays import NamedArrays, require_h5py
from balloon_warp.outputs.world_files.world_file import Field, Slot, WorldFile, own_attributes


class Hdf5:
    """HDF5: the first file of a model is made by h5py, and others are copies of all but its frames.

    Raises:
        MissingExtraError: h5py is not installed.
    """

    suffix = work_suffix = ".h5"

    def __init__(self) -> None:
        self._h5py = require_h5py()
        self._first: WorldFile | None = None
        self._offsets: dict[str, int] = {}
        self._size = 0
        self._pieces: list[tuple[int, bytes]] = []

    def create(self, path: Path, world: WorldFile) -> None:
        """See `Format`."""
        if self._first is None:
            self._write(path, world)
            self._first = world
            self._look_at(path, world.moving)
            return
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
        try:
            os.ftruncate(descriptor, self._size)
            for offset, piece in self._pieces:
                os.pwrite(descriptor, piece, offset)
        finally:
            os.close(descriptor)
        self._change(path, own_attributes(world, self._first))

    def slots(self, path: Path, moving: Sequence[Field]) -> dict[str, Slot]:
        """See `Format`."""
        if not self._offsets:
            self._look_at(path, moving)
        return {name: Slot(path, offset) for name, offset in self._offsets.items()}

    def finish(self, path: Path, world: WorldFile) -> Path:
        """See `Format`."""
        if world.attributes["health"] != 1:
            self._change(path, {"health": world.attributes["health"]})
        return path

    def _write(self, path: Path, world: WorldFile) -> None:
        h5py = self._h5py
        with h5py.File(path, "w") as file:
            file.attrs.update(world.attributes)
            arrays = NamedArrays(file)
            for field, values in world.fixed:
                arrays.add(field.name, values, field.dimensions, field.unit)
            for field in world.moving:
                whole = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
                whole.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
                whole.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
                arrays.room(field.name, field.shape, field.dimensions, field.unit, field.dtype, dcpl=whole)

    def _look_at(self, path: Path, moving: Sequence[Field]) -> None:
        """Note where the frames are, and all that is beside them."""
        with self._h5py.File(path, "r") as file:
            self._offsets = {field.name: file[field.name].id.get_offset() for field in moving}
        self._size = path.stat().st_size
        taken = sorted((self._offsets[field.name], field.bytes) for field in moving)
        begins = [0, *(offset + size for offset, size in taken)]
        ends = [*(offset for offset, _ in taken), self._size]
        with path.open("rb") as file:
            for begin, end in zip(begins, ends, strict=True):
                file.seek(begin)
                self._pieces.append((begin, file.read(end - begin)))

    def _change(self, path: Path, attributes: dict[str, Any]) -> None:
        with self._h5py.File(path, "r+") as file:
            for name, value in attributes.items():
                file.attrs.modify(name, value)

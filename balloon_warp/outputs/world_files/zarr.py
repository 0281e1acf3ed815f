"""The file of a world as a Zarr store of version 2: a folder, with an array a folder and each array in one piece."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from balloon_warp.outputs.world_files.world_file import Field, Slot, WorldFile


class Zarr:
    """Zarr 2, which versions 2 and 3 of its library read, and xarray. It is written without them."""

    suffix = work_suffix = ".zarr"

    def create(self, path: Path, world: WorldFile) -> None:
        """See `Format`."""
        path.mkdir()
        for field, values in world.fixed:
            self._create(path, field).write_bytes(values.astype(field.dtype).tobytes())
        for field in world.moving:
            with self._create(path, field).open("wb") as file:
                file.truncate(field.bytes)
        self._describe(path, world)

    def slots(self, path: Path, moving: Sequence[Field]) -> dict[str, Slot]:
        """See `Format`."""
        return {field.name: Slot(_piece(path, field), 0) for field in moving}

    def finish(self, path: Path, world: WorldFile) -> Path:
        """See `Format`."""
        if world.attributes["health"] != 1:
            self._describe(path, world)
        return path

    @staticmethod
    def _create(path: Path, field: Field) -> Path:
        (path / field.name).mkdir()
        for name, said in _array(field).items():
            (path / field.name / name).write_text(json.dumps(said), encoding="utf-8")
        return _piece(path, field)

    @staticmethod
    def _describe(path: Path, world: WorldFile) -> None:
        """Write the attributes, and what says of all arrays at once what there is."""
        said: dict[str, Any] = {".zgroup": {"zarr_format": 2}, ".zattrs": dict(world.attributes)}
        for name, value in said.items():
            (path / name).write_text(json.dumps(value), encoding="utf-8")
        for field in (*(field for field, _ in world.fixed), *world.moving):
            said |= {f"{field.name}/{name}": value for name, value in _array(field).items()}
        text = json.dumps({"zarr_consolidated_format": 1, "metadata": said})
        (path / ".zmetadata").write_text(text, encoding="utf-8")


def _array(field: Field) -> dict[str, Any]:
    """Describe an array, by the names of the files that do."""
    array = {
        "zarr_format": 2,
        "shape": field.shape,
        "chunks": field.shape,
        "dtype": field.dtype,
        "compressor": None,
        "fill_value": None,  # else readers take zeros for missing
        "order": "C",
        "filters": None,
    }
    return {".zarray": array, ".zattrs": {"_ARRAY_DIMENSIONS": field.dimensions, "units": field.unit}}


def _piece(path: Path, field: Field) -> Path:
    return path / field.name / ".".join("0" for _ in field.shape)

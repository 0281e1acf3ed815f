"""The file of a world as a Zarr store of version 2: a folder, with an array a folder."""

import json
from pathlib import Path
from typing import Any

from balloon_warp.outputs.world_files.packing import LEVEL, chunk_shape, chunks_of, packed
from balloon_warp.outputs.world_files.world_file import Field, FileContents


class Zarr:
    """Zarr 2, which versions 2 and 3 of its library read, and xarray. It is written without them."""

    suffix = ".zarr"

    def write(self, path: Path, contents: FileContents) -> None:
        """See `Format`."""
        path.mkdir()
        for field, values in contents.arrays:
            (path / field.name).mkdir()
            for name, said in _array(field).items():
                (path / field.name / name).write_text(json.dumps(said), encoding="utf-8")
            for number, piece in enumerate(chunks_of(field, values)):
                name = ".".join([str(number), *("0" for _ in field.shape[1:])])
                (path / field.name / name).write_bytes(packed(piece))
        self._describe(path, contents)

    @staticmethod
    def _describe(path: Path, contents: FileContents) -> None:
        """Write the attributes, and the consolidated metadata of all arrays."""
        said: dict[str, Any] = {".zgroup": {"zarr_format": 2}, ".zattrs": dict(contents.attributes)}
        for name, value in said.items():
            (path / name).write_text(json.dumps(value), encoding="utf-8")
        for field, _ in contents.arrays:
            said |= {f"{field.name}/{name}": value for name, value in _array(field).items()}
        text = json.dumps({"zarr_consolidated_format": 1, "metadata": said})
        (path / ".zmetadata").write_text(text, encoding="utf-8")


def _array(field: Field) -> dict[str, Any]:
    """Describe an array, by the names of the files that do."""
    array = {
        "zarr_format": 2,
        "shape": field.shape,
        "chunks": chunk_shape(field),
        "dtype": field.dtype,
        "compressor": {"id": "zlib", "level": LEVEL},
        "fill_value": None,  # else readers take zeros for missing
        "order": "C",
        "filters": [{"id": "shuffle", "elementsize": int(field.dtype[-1])}],
    }
    return {".zarray": array, ".zattrs": {"_ARRAY_DIMENSIONS": field.dimensions, "units": field.unit}}

"""Formats of the files of worlds, by their names."""

from pathlib import Path
from typing import Protocol

from balloon_warp.errors import InputError
from balloon_warp.outputs.world_files.hdf5 import Hdf5
from balloon_warp.outputs.world_files.npz import Npz
from balloon_warp.outputs.world_files.world_file import FileContents
from balloon_warp.outputs.world_files.zarr import Zarr


class Format(Protocol):
    """A format. Files of several worlds may be written at the same time."""

    suffix: str

    def write(self, path: Path, contents: FileContents) -> None:
        """Write a file."""
        ...


FORMATS: dict[str, type[Format]] = {"h5": Hdf5, "zarr": Zarr, "npz": Npz}


def format_named(name: str) -> type[Format]:
    """Return a format.

    Raises:
        InputError: there is none of that name.
        MissingExtraError: its package is not installed.
    """
    if name not in FORMATS:
        raise InputError(f"format {name}: expected {', '.join(FORMATS)}")
    FORMATS[name]()  # which says if a package is missing
    return FORMATS[name]

"""Formats of the files of worlds, by their names."""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from balloon_warp.errors import InputError
from balloon_warp.outputs.world_files.hdf5 import Hdf5
from balloon_warp.outputs.world_files.npz import Npz
from balloon_warp.outputs.world_files.world_file import Field, Slot, WorldFile
from balloon_warp.outputs.world_files.zarr import Zarr


class Format(Protocol):
    """A format, for the worlds of one model, which have the same arrays."""

    suffix: str
    """Suffix of a file in its place"""
    work_suffix: str
    """Suffix of a file that is still written"""

    def create(self, path: Path, world: WorldFile) -> None:
        """Create a world's file, with room for all that moves."""
        ...

    def slots(self, path: Path, moving: Sequence[Field]) -> dict[str, Slot]:
        """Find where each moving array of a created file begins."""
        ...

    def finish(self, path: Path, world: WorldFile) -> Path:
        """Finish a file whose frames are all there, and return what goes to its place."""
        ...


FORMATS: dict[str, type[Format]] = {"h5": Hdf5, "zarr": Zarr, "npz": Npz}


def format_named(name: str) -> type[Format]:
    """Return a format.

    Raises:
        InputError: there is none of that name.
        MissingExtraError: its package is not installed.
    """
    if name not in FORMATS:
        raise InputError(f"--format {name}: expected {', '.join(FORMATS)}")
    FORMATS[name]()  # which says if a package is missing
    return FORMATS[name]

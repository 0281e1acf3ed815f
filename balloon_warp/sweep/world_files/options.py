"""Options of the trajectories of a batch: their folder, kind and interval."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from typing_extensions import TypeAliasType

from balloon_warp.arguments import check_fields
from balloon_warp.errors import InputError
from balloon_warp.outputs.world_files import format_named
from balloon_warp.shown import Shown, described


@described
@dataclass(frozen=True)
class TrajectoryFiles(Shown):
    """Files of a batch's trajectories, one for each world, in folders for training, validation and test.

    Raises:
        InputError: a value cannot be.
        MissingExtraError: the format is "h5", and h5py is not installed.
    """

    folder: str | Path
    """Folder, made if it is not there"""
    every: int = 1
    """Step between frames that are written: 2 for every second"""
    format: Literal["h5", "zarr", "npz"] = "h5"
    seed: int = 0
    """Seed of the splits"""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.every < 1:
            raise InputError(f"every {self.every}: expected a whole number of at least 1")
        if self.seed < 0:
            raise InputError(f"seed {self.seed}: expected a whole number of at least 0")
        format_named(self.format)

    @classmethod
    def of(cls, given: "TrajectoryFiles | str | Path | None") -> "TrajectoryFiles | None":
        """Return the options, made of a folder alone if need be."""
        return cls(given) if isinstance(given, str | Path) else given

    def as_json(self) -> dict[str, Any]:
        """Describe the options for a manifest, which tells nobody where the folder was."""
        return {"folder": Path(self.folder).name, "every": self.every, "format": self.format, "seed": self.seed}


TrajectoryFilesLike = TypeAliasType("TrajectoryFilesLike", TrajectoryFiles | str | Path)
"""Files of trajectories, or a folder for them with the defaults"""

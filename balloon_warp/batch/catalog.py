"""Manifest of a folder of trajectories: its files, its splits, means and deviations."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypeAliasType

from balloon_warp.batch.contents import Contents
from balloon_warp.batch.formats import AXES, Field, WorldFile, chunk_shape, format_named
from balloon_warp.errors import InputError
from balloon_warp.run.provenance import installed_versions
from balloon_warp.system.arguments import check_fields
from balloon_warp.system.files import manifest_text, whole_file
from balloon_warp.system.shown import Shown, described

SPLITS = ("train", "validation", "test")
OF_TEN = (8, 1, 1)
"""Number of each ten worlds that go to each split"""


def splits_of(world_count: int, seed: int) -> NDArray[np.int64]:
    """Draw the split of each world, a number of `SPLITS`, shape (world_count,).

    Each ten worlds in a row have eight for training, one for validation and one for test. The split of a world depends
    on the seed and its number alone, so that a larger batch keeps it.
    """
    ten = np.repeat(np.arange(len(SPLITS)), OF_TEN)
    tens = [np.random.default_rng([seed, number]).permutation(ten) for number in range(-(-world_count // len(ten)))]
    return np.concatenate([np.zeros(0, dtype=np.int64), *tens])[:world_count]


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


@dataclass(frozen=True)
class Moments:
    """Count, mean and sum of squared differences from it, of each component (Chan et al. 1983)."""

    count: int
    mean: NDArray[np.float64]
    squares: NDArray[np.float64]

    @classmethod
    def of(cls, field: Field, values: NDArray) -> Self:
        """Return the moments of an array, by pieces: of vectors by component, of other arrays of all numbers."""
        components = field.shape[-1] if field.dimensions[-1] in AXES else 1
        total, rows = cls(0, np.zeros(components), np.zeros(components)), chunk_shape(field)[0]
        for begin in range(0, len(values), rows):
            piece = values[begin : begin + rows].reshape(-1, components).astype(np.float64)
            mean = piece.mean(axis=0)
            total = total.with_more(cls(len(piece), mean, ((piece - mean) ** 2).sum(axis=0)))
        return total

    def with_more(self, other: Self) -> Self:
        """Return the moments of both together."""
        count = self.count + other.count
        if not count:
            return self
        apart, share = other.mean - self.mean, other.count / count
        mean = self.mean + share * apart
        return type(self)(count, mean, self.squares + other.squares + apart**2 * self.count * share)

    def as_json(self) -> dict[str, Any]:
        """Describe the moments for a manifest: numbers of vectors by component, or a number."""
        deviation = np.sqrt(self.squares / max(self.count, 1))
        told = {"mean": self.mean.tolist(), "deviation": deviation.tolist()}
        return {name: numbers if len(numbers) > 1 else numbers[0] for name, numbers in told.items()}


MANIFEST_NAME = "manifest.json"
STATIC_FOLDER = "static"
"""Name of the folder of static fields, and the beginning of its files' names"""


def write_catalog(
    folder: Path,
    options: TrajectoryFiles,
    contents: Contents,
    world: WorldFile,
    names: Sequence[str],
    health: NDArray[np.integer],
    static: Sequence[str],
    moments: Mapping[str, Moments],
) -> None:
    """Write the manifest, after the files that it names.

    Args:
        world: contents of the first one.
        names: of the files, by world.
        health: of each world at the end.
        static: names of the files with static fields.
        moments: of each moving field, over the files for training, if there are any.

    Raises:
        InputError: it cannot be written.
    """
    scene = contents.scene
    manifest: dict[str, Any] = {
        "format": options.format,
        "frames": contents.frames,
        "every": options.every,
        "time_step": options.every / scene.frames_per_second,
        "seed": options.seed,
        "static": list(static),
        "splits": {split: [name for name in names if name.startswith(f"{split}/")] for split in SPLITS},
        "blew_up": [name for name, well in zip(names, health.tolist(), strict=True) if well == 0],
        "restarted": [name for name, well in zip(names, health.tolist(), strict=True) if well == 2],
        "fields": {
            **{field.name: field.as_json() for field, _ in (*world.static, *world.times)},
            **{
                field.name: field.as_json() | (moments[field.name].as_json() if field.name in moments else {})
                for field in world.moving
            },
        },
        "vary": contents.columns,
        "units": json.loads(str(world.attributes["units"])),
        **contents.described,
        "versions": installed_versions(),
    }
    with whole_file(folder / MANIFEST_NAME) as path:
        path.write_text(manifest_text(manifest), encoding="utf-8")


def listed_files(folder: Path) -> set[str]:
    """List the files that an earlier manifest names; none where there is none, or it is something else."""
    try:
        said = json.loads((folder / MANIFEST_NAME).read_text(encoding="utf-8"))
        names = {name for split in SPLITS for name in said["splits"][split]} | set(said.get("static", ()))
    except (OSError, ValueError, KeyError, TypeError):
        return set()
    ours = rf"(({'|'.join(SPLITS)})/world|{STATIC_FOLDER}/{STATIC_FOLDER})_\d+\.\w+"
    return {name for name in names if re.fullmatch(ours, str(name))}

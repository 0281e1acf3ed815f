"""Manifest of a folder of trajectories: what its files are, and which are for training, validation and test."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.files import whole_file
from balloon_warp.marks import manifest_text
from balloon_warp.outputs.world_files import WorldFile
from balloon_warp.provenance import installed_versions
from balloon_warp.sweep.world_files.contents import Contents
from balloon_warp.sweep.world_files.options import TrajectoryFiles
from balloon_warp.sweep.world_files.splits import SPLITS

MANIFEST_NAME = "manifest.json"


def write_catalog(
    folder: Path,
    options: TrajectoryFiles,
    contents: Contents,
    world: WorldFile,
    names: Sequence[str],
    health: NDArray[np.integer],
) -> None:
    """Write the manifest, after the files that it names.

    Args:
        world: what stands in the first one.
        names: of the files, by world.
        health: of each world at the end.

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
        "splits": {split: [name for name in names if name.startswith(f"{split}/")] for split in SPLITS},
        "blew_up": [name for name, well in zip(names, health.tolist(), strict=True) if well == 0],
        "restarted": [name for name, well in zip(names, health.tolist(), strict=True) if well == 2],
        "fields": {
            field.name: {"dimensions": field.dimensions, "dtype": field.dtype, "unit": field.unit, "is": field.meaning}
            for field in (*(field for field, _ in world.fixed), *world.moving)
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
        splits = json.loads((folder / MANIFEST_NAME).read_text(encoding="utf-8"))["splits"]
        names = {name for split in SPLITS for name in splits[split]}
    except (OSError, ValueError, KeyError, TypeError):
        return set()
    return {name for name in names if re.fullmatch(rf"({'|'.join(SPLITS)})/world_\d+\.\w+", str(name))}

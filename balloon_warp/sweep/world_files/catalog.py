"""Manifest of a folder of trajectories: its files, and which are for training, validation and test."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.files import whole_file
from balloon_warp.marks import manifest_text
from balloon_warp.outputs.world_files import WorldFile
from balloon_warp.provenance import installed_versions
from balloon_warp.sweep.world_files.contents import Contents
from balloon_warp.sweep.world_files.moments import Moments
from balloon_warp.sweep.world_files.options import TrajectoryFiles
from balloon_warp.sweep.world_files.splits import SPLITS

MANIFEST_NAME = "manifest.json"
STATIC = "static"
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
    ours = rf"(({'|'.join(SPLITS)})/world|{STATIC}/{STATIC})_\d+\.\w+"
    return {name for name in names if re.fullmatch(ours, str(name))}

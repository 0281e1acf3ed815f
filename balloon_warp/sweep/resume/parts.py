"""Parts of a batch's output that are whole files of their own: some frames of some of its groups."""

import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.files import whole_file
from balloon_warp.outputs.npz import write_npz
from balloon_warp.sweep.output import BatchOutput


@dataclass(frozen=True)
class Part:
    """Part of a batch."""

    frames: range
    groups: Sequence[int]
    """Numbers of the groups, or of a cluster's shares"""
    notes: Mapping[str, Any] = field(default_factory=dict)
    """Notes besides rows and shapes, as JSON"""


def write_rows(output: BatchOutput, part: Part, rows: Path) -> None:
    """Copy a part of a table.

    It is `frames`, `groups`, the `worlds` of these groups, the names of what is measured, `columns`, and of each
    frame and world its `values` and `health`; of each world its `contacts`; `notes` is JSON.

    Raises:
        InputError: it cannot be written.
    """
    if output.trajectories:
        output.trajectories.save()
    table = output.table
    worlds = np.concatenate([output.groups[group].worlds for group in part.groups])
    block = slice(part.frames.start, part.frames.stop), worlds
    with whole_file(rows) as path:
        arrays = {
            "frames": np.array(part.frames, dtype=np.int32),
            "groups": np.array(part.groups, dtype=np.int32),
            "worlds": worlds,
            "notes": np.array(json.dumps(part.notes)),
            "columns": np.array(table.measures),
            "values": table.values[block],
            "health": table.health[block],
            "contacts": output.contacts[worlds],
        }
        write_npz(path, arrays.items())


def read_part(output: BatchOutput, rows: Path, stage: Path) -> Part:
    """Copy a part into an output, of the stage, too, where worlds are chosen.

    Raises:
        InputError: a file is not there, or damaged.
    """
    try:
        with np.load(rows) as saved:
            frames = range(int(saved["frames"][0]), int(saved["frames"][-1]) + 1)
            part = Part(frames, saved["groups"].tolist(), json.loads(str(saved["notes"])))
            block = slice(frames.start, frames.stop), saved["worlds"]
            output.table.values[block], output.table.health[block] = saved["values"], saved["health"]
            output.contacts[saved["worlds"]] = saved["contacts"]
    except (OSError, ValueError, KeyError, IndexError, zipfile.BadZipFile) as error:
        raise InputError(f"{rows}: cannot be read: {error}; expected a part of a batch's table") from None
    if output.stage:
        output.stage.copy_part(stage, part.frames, part.groups)
    return part

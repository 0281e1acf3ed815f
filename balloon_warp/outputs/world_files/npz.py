"""The file of a world as NumPy's .npz: arrays by their names, and `attributes` as JSON."""

import json
from pathlib import Path

import numpy as np

from balloon_warp.outputs.npz import write_npz
from balloon_warp.outputs.world_files.packing import LEVEL
from balloon_warp.outputs.world_files.world_file import FileContents


class Npz:
    """NumPy's .npz."""

    suffix = ".npz"

    def write(self, path: Path, contents: FileContents) -> None:
        """See `Format`."""
        attributes = np.array(json.dumps(dict(contents.attributes)))
        arrays = ((field.name, np.asarray(values)) for field, values in contents.arrays)
        write_npz(path, (*arrays, ("attributes", attributes)), LEVEL)

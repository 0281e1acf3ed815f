"""The file of a world as NumPy's .npz: arrays by their names, and `attributes` as JSON."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from balloon_warp.outputs.npz import write_npz
from balloon_warp.outputs.world_files.world_file import Field, Slot, WorldFile


class Npz:
    """NumPy's .npz. Frames go to a file of nothing else first: an .npz has a checksum before each array."""

    suffix, work_suffix = ".npz", ".frames"

    def create(self, path: Path, world: WorldFile) -> None:
        """See `Format`."""
        with path.open("wb") as file:
            file.truncate(sum(field.bytes for field in world.moving))

    def slots(self, path: Path, moving: Sequence[Field]) -> dict[str, Slot]:
        """See `Format`."""
        begins = np.cumsum([0, *(field.bytes for field in moving)]).tolist()
        return {field.name: Slot(path, begin) for field, begin in zip(moving, begins, strict=False)}

    def finish(self, path: Path, world: WorldFile) -> Path:
        """See `Format`."""
        whole = path.with_suffix(self.suffix)
        slots = self.slots(path, world.moving)
        fixed = [(field.name, values) for field, values in world.fixed]
        moving = (
            (field.name, np.memmap(path, field.dtype, "r", slots[field.name].offset, field.shape))
            for field in world.moving
        )
        attributes = np.array(json.dumps(dict(world.attributes)))
        write_npz(whole, (*fixed, *moving, ("attributes", attributes)))
        return whole

"""The laws' parameters in memory: a row of numbers for each balloon, and one for each world."""

from collections.abc import Mapping, Sequence

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.laws import Parameter
from balloon_warp.kernels.laws.columns import Columns


def pack_balloons(columns: Columns, parameters: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the numbers of balloons, shape (W, balloon_count, columns.balloon_width)."""
    return _beside(columns.balloon, parameters)


def pack_worlds(columns: Columns, parameters: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the numbers of worlds, shape (W, columns.world_width)."""
    return _beside(columns.world, parameters)


def views_of(columns: Columns, balloon_numbers: wp.array, world_numbers: wp.array) -> dict[str, wp.array]:
    """Return the parameters by name, shape (W, balloon_count) or (W,), with a last dimension of 3 for vectors."""
    views, column = {}, 0
    for row in columns.balloon:
        views[row.name] = balloon_numbers[:, :, column if row.size == 1 else slice(column, column + row.size)]
        column += row.size
    column = 0
    for row in columns.world:
        views[row.name] = world_numbers[:, column if row.size == 1 else slice(column, column + row.size)]
        column += row.size
    return views


def _beside(rows: Sequence[Parameter], parameters: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the columns of all rows; where one differs between worlds, another's row stands for all worlds."""
    parts = [parameters[row.name][..., None] if row.size == 1 else parameters[row.name] for row in rows]
    worlds = max(len(part) for part in parts)
    return np.concatenate([np.broadcast_to(part, (worlds, *part.shape[1:])) for part in parts], axis=-1)

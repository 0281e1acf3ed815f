"""Parameters in memory: a row of numbers for each balloon, for each sphere, and for each world."""

from collections.abc import Mapping, Sequence

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.laws import Parameter
from balloon_warp.kernels.laws.columns import Columns


def pack(columns: Columns, parameters: Mapping[str, NDArray[np.float64]], device: wp.Device) -> dict[str, wp.array]:
    """Return the numbers of balloons and spheres, shape (W, count, width), and of worlds, shape (W, width)."""
    rows = {"balloon_numbers": columns.balloon, "sphere_numbers": columns.sphere, "world_numbers": columns.world}
    return {name: wp.array(_beside(of, parameters), dtype=wp.float32, device=device) for name, of in rows.items()}


def views_of(
    columns: Columns, balloon_numbers: wp.array, world_numbers: wp.array, sphere_numbers: wp.array
) -> dict[str, wp.array]:
    """Return the parameters by name, shape (W, count) or (W,), with a last dimension of 3 for vectors."""
    views = {}
    for rows, numbers in (
        (columns.balloon, balloon_numbers),
        (columns.world, world_numbers),
        (columns.sphere, sphere_numbers),
    ):
        column, before = 0, (slice(None),) * (numbers.ndim - 1)
        for row in rows:
            own = column if row.size == 1 else slice(column, column + row.size)
            views[row.name] = numbers[(*before, own)] if numbers.size else _none(numbers, row)
            column += row.size
    return views


def _none(numbers: wp.array, row: Parameter) -> wp.array:
    """Return the parameter where there is nothing that has it; Warp takes no view of an empty array."""
    shape = (*numbers.shape[:-1], row.size) if row.size > 1 else numbers.shape[:-1]
    return wp.zeros(shape, dtype=wp.float32, device=numbers.device)


def _beside(rows: Sequence[Parameter], parameters: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the columns of all rows; where one differs between worlds, another's row stands for all worlds."""
    parts = [parameters[row.name][..., None] if row.size == 1 else parameters[row.name] for row in rows]
    worlds = max(len(part) for part in parts)
    return np.concatenate([np.broadcast_to(part, (worlds, *part.shape[1:])) for part in parts], axis=-1)

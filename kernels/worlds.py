"""What is alike in all worlds, or differs from world to world."""

import warp as wp


@wp.kernel(enable_backward=False)
def spread_over_worlds(rows: wp.array2d[wp.vec3], every: wp.array2d[wp.vec3]):
    """A thread a (world, item): a copy of its row, or of the one row that all worlds share."""
    world, item = wp.tid()
    every[world, item] = rows[world % rows.shape[0], item]

"""What is alike in all worlds, or differs from world to world."""

from typing import Any

import warp as wp


@wp.kernel(enable_backward=False)
def spread_over_worlds(rows: wp.array2d[Any], every: wp.array2d[Any]):
    """A thread a (world, item): a copy of its row, or of the one row that all worlds share."""
    world, item = wp.tid()
    every[world, item] = rows[world % rows.shape[0], item]


@wp.kernel(enable_backward=False)
def place_balloons(
    # model
    points: wp.array[wp.vec3d],
    shifts: wp.array2d[wp.vec3d],
    particle_balloon: wp.array[wp.int32],
    # out
    every: wp.array2d[wp.vec3],
):
    """A thread a (world, particle): its place. In double precision, so that it is what the host would place there."""
    world, particle = wp.tid()
    every[world, particle] = wp.vec3(points[particle] + shifts[world % shifts.shape[0], particle_balloon[particle]])


@wp.kernel(enable_backward=False)
def pick_healthy_worlds(
    every: wp.array2d[wp.vec3], healthy: wp.array[wp.int32], chosen: wp.array[wp.int32], picked: wp.array2d[wp.vec3]
):
    """A thread a (chosen world, item): a copy of it; of a world that is not healthy, the last good copy stays."""
    place, item = wp.tid()
    world = chosen[place]
    if healthy[world] == 1:
        picked[place, item] = every[world, item]

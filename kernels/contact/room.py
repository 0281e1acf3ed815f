"""Room of lists of contacts: where one is full it notes how long it would have to be, and the host makes it longer."""

import warp as wp

from balloon_warp.kernels.working import Working

OF_TRIANGLES, OF_PAIRS, OF_CATCHES, OF_RIDGES = (wp.constant(which) for which in range(4))
"""Lists: triangles of a particle; pairs of edges, those that may touch in a substep, and of ridges, of a world"""
LISTS = 4
"""Number of these"""


@wp.func
def ask_for_room(working: Working, world: wp.int32, which: wp.int32, needed: wp.int32, ignored: wp.int32):
    """Note how long a list would have to be, and count the entries that it has no place for."""
    wp.atomic_max(working.needs, world, which, needed)
    wp.atomic_add(working.overflow, world, ignored)

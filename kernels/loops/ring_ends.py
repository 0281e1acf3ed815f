"""The particles around a particle, as the table of rings has them."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.memory import in_tile, int_pair_at, packed_pair_at
from balloon_warp.kernels.tables import RingTable


@cache
def ring_ends(at: Any) -> Any:
    """Return the function that reads the ends of two springs in the schedule's layout."""
    packed = at is in_tile

    @wp.func
    def ends_at(rings: RingTable, entry: wp.int32):
        if wp.static(packed):
            return packed_pair_at(rings.packed_ends, entry)
        else:
            return int_pair_at(rings.ends, entry)

    return ends_at

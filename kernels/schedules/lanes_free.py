"""Free frames in lanes: which groups have one, and whether a world went further than was free, see `free_frames`."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import Lanes
from balloon_warp.kernels.schedules.free_frames import FREE, note_hurry
from balloon_warp.kernels.schedules.lanes_tables import lane_structs
from balloon_warp.kernels.schedules.layouts import Layout, places_of


@cache
def free_functions(layout: Layout) -> tuple[Any, Any]:
    """The functions that say whether any world of a group has a free frame, and that note which went too far."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    places = places_of(layout)

    @wp.func
    def any_free(t: LaneTables, lanes: LaneState, group: wp.int32):
        found = bool(False)
        for lane in range(t.lane_count):
            found = found or lanes.free.verdicts[places.world(group, lane, t.world_count)] == FREE
        lanes.farthest[group] = Lanes()
        return found

    @wp.func
    def note_hurried_worlds(t: LaneTables, lanes: LaneState, group: wp.int32):
        for lane in range(t.lane_count):
            world = places.world(group, lane, t.world_count)
            note_hurry(lanes.free, world, lanes.farthest[group][lane], t.all.substeps)

    return any_free, note_hurried_worlds

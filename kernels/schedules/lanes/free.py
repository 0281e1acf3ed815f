"""Free frames in lanes: which groups have one, and whether a world went further than was free, see `free_frames`."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import Lanes, Lanes3, larger, squared_length
from balloon_warp.kernels.schedules.free_frames import FREE, goes_too_far, note_hurry
from balloon_warp.kernels.schedules.lanes.layouts import Layout, places_of
from balloon_warp.kernels.schedules.lanes.tables import Frames, lane_structs


@cache
def free_functions(layout: Layout) -> dict[str, Any]:
    """The functions that say whether any world of a group has a free frame, that note how fast an item was in a
    substep, and which worlds went too far; by their names."""
    LaneTables, places = lane_structs(layout).tables, places_of(layout)  # noqa: N806 - a type

    @wp.func
    def any_free(t: LaneTables, frames: Frames, group: wp.int32):
        found = bool(False)
        for lane in range(t.lane_count):
            found = found or frames.free.verdicts[places.world(group, lane, t.world_count)] == FREE
        frames.fastest[group] = Lanes()
        return found

    @wp.func
    def note_speed(t: LaneTables, frames: Frames, group: wp.int32, before: Lanes3, after: Lanes3):
        """[m^2/s^2]. What spheres or the ground shift goes further than its velocity says."""
        squared = squared_length(after - before) / (t.step_seconds * t.step_seconds)
        frames.fastest[group] = larger(frames.fastest[group], squared)

    @wp.func
    def note_hurried_worlds(t: LaneTables, frames: Frames, group: wp.int32):
        for lane in range(t.lane_count):
            world = places.world(group, lane, t.world_count)
            if goes_too_far(frames.free, world, frames.fastest[group][lane], t.all.frame_seconds):
                note_hurry(frames.free, world)

    return {"any_free": any_free, "note_speed": note_speed, "note_hurried_worlds": note_hurried_worlds}

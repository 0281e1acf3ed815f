"""Free frames in lanes: which groups have one, and whether a world went further than was free, see `free_frames`."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import Lanes, Lanes3, squared_length
from balloon_warp.kernels.contact.free_frames import FREE, goes_too_far, note_hurry
from balloon_warp.kernels.schedules.lanes.layouts import Layout, places_of
from balloon_warp.kernels.schedules.lanes.tables import lane_structs
from balloon_warp.kernels.traits import Traits


@cache
def free_functions(traits: Traits, layout: Layout) -> tuple[Any, Any, Any]:
    """The functions that say whether any world of a group has a free frame, how fast an item was in a substep, and that
    note which worlds went too far."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    places = places_of(layout)

    @wp.func
    def any_free(t: LaneTables, lanes: LaneState, group: wp.int32):
        found = bool(False)
        for lane in range(t.lane_count):
            found = found or lanes.free.verdicts[places.world(group, lane, t.world_count)] == FREE
        lanes.fastest[group] = Lanes()
        return found

    @wp.func
    def squared_speed(t: LaneTables, before: Lanes3, after: Lanes3, velocity: Lanes3):
        """[m^2/s^2]. What spheres or the ground shift goes further than its velocity says."""
        if wp.static(traits.obstacles):
            return squared_length(after - before) / (t.step_seconds * t.step_seconds)
        else:
            return squared_length(velocity)

    @wp.func
    def note_hurried_worlds(t: LaneTables, lanes: LaneState, group: wp.int32):
        for lane in range(t.lane_count):
            world = places.world(group, lane, t.world_count)
            if goes_too_far(lanes.free, world, lanes.fastest[group][lane], t.all.frame_seconds):
                note_hurry(lanes.free, world)

    return any_free, squared_speed, note_hurried_worlds

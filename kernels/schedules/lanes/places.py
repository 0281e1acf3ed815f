"""Worlds and particles that lanes hold, by layout."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.lanes import LANE_COUNT, total_in
from balloon_warp.kernels.schedules.lanes.layouts import Layout


class Places(NamedTuple):
    """World and particle that a lane holds."""

    world: Any
    """(group, lane, world_count) to the world in a lane; lanes that are left over copy the last world"""
    worlds: Any
    """(group, world_count) to how many worlds a group has"""
    first_world: Any
    """(group) to the first of them"""
    is_there: Any
    """(t, group, item, lane) to whether a lane holds a particle that no other lane holds"""
    particle: Any
    """(t, item, lane) to the particle in a lane; the padding of an octet copies the first there"""
    totals: Any
    """Function that reduces sums of lanes to sums of worlds"""


@cache
def places_of(layout: Layout) -> Places:
    """Return the places of lanes in a layout."""

    @wp.func
    def world_in_lane(group: wp.int32, lane: wp.int32, world_count: wp.int32):
        if wp.static(layout.worlds):
            return wp.min(group * LANE_COUNT + lane, world_count - 1)
        else:
            return group

    @wp.func
    def first_world(group: wp.int32):
        if wp.static(layout.worlds):
            return group * LANE_COUNT
        else:
            return group

    @wp.func
    def worlds_of(group: wp.int32, world_count: wp.int32):
        if wp.static(layout.worlds):
            return wp.min(world_count - group * LANE_COUNT, LANE_COUNT)
        else:
            return 1

    @wp.func
    def is_there(t: Any, group: wp.int32, item: wp.int32, lane: wp.int32):
        if wp.static(layout.worlds):
            return group * LANE_COUNT + lane < t.world_count
        else:
            return t.particles[LANE_COUNT * item + lane] >= 0

    @wp.func
    def particle_in_lane(t: Any, item: wp.int32, lane: wp.int32):
        if wp.static(layout.worlds):
            return item
        else:
            number = t.particles[LANE_COUNT * item + lane]
            return wp.where(number >= 0, number, t.particles[LANE_COUNT * item])

    @wp.func
    def totals_of(parts: Any):
        if wp.static(layout.worlds):
            return parts
        else:
            return total_in(parts)

    return Places(world_in_lane, worlds_of, first_world, is_there, particle_in_lane, totals_of)

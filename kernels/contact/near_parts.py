"""Parts of a balloon that are near each other, for a balloon that touches itself.

A search finds them once for each leaf of the tree of parts, and all particles and edges of the leaf look into those:
without, each would go through the tree by itself, and find mostly its neighborhood on the surface.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.boxes import ARE_NEAR, boxes_meet, pad_function
from balloon_warp.kernels.contact.clearances import pays_to_look_out
from balloon_warp.kernels.contact.parts import lower_of_part, upper_of_part
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.memory import four_ints_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working

MOST_PARTS = wp.constant(32)
"""Largest number of leaves near a leaf that are listed; where there are more, the tree is searched"""
TOO_MANY = wp.constant(-1)
"""Number of near leaves where there are more than fit"""


@wp.func
def list_near_parts(t: Tables, working: Working, world: wp.int32, part: wp.int32, balloon: wp.int32, pad: float):
    """List the leaves of a balloon that may come within a distance of a leaf [m]."""
    low = lower_of_part(working, world, part)
    high = upper_of_part(working, world, part)
    lower = wp.vec3(low[0], low[1], low[2])
    upper = wp.vec3(high[0], high[1], high[2])
    count = wp.int32(0)
    other = t.touch.balloon_parts[balloon]
    last = t.touch.balloon_parts[balloon + 1]
    while other < last:
        after = four_ints_at(t.touch.parts, other)[0]
        its_low = lower_of_part(working, world, other)
        its_high = upper_of_part(working, world, other)
        its_lower = wp.vec3(its_low[0], its_low[1], its_low[2])
        if boxes_meet(lower, upper, its_lower, wp.vec3(its_high[0], its_high[1], its_high[2]), pad):
            if after == other + 1:
                if count < MOST_PARTS:
                    working.near_parts[world, part, count] = other
                count += 1
            after = other + 1
        other = after
    working.near_part_counts[world, part] = wp.where(count > MOST_PARTS, TOO_MANY, count)


@wp.func
def begin_of_parts(t: Tables, balloon: wp.int32, count: wp.int32):
    """Return where a search among the parts of a balloon begins: in the list of near leaves, if it has a length."""
    return wp.where(count >= 0, 0, t.touch.balloon_parts[balloon])


@wp.func
def end_of_parts(t: Tables, balloon: wp.int32, count: wp.int32):
    """Return where a search among the parts of a balloon ends."""
    return wp.where(count >= 0, count, t.touch.balloon_parts[balloon + 1])


@wp.func
def part_of_search(working: Working, world: wp.int32, home: wp.int32, at: wp.int32, count: wp.int32):
    """Return the part at a place of a search.

    Args:
        home: Leaf whose list of near leaves is searched.
        count: Length of that list; negative where the tree is searched.
    """
    if count >= 0:
        return working.near_parts[world, home, at]
    return at


@cache
def near_parts_kernel(features: Features) -> Any:
    """Return the kernel that lists the leaves near each leaf."""
    pad_between = pad_function(features)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def find_near_parts(
        # model
        t: Tables,
        threads: wp.int32,
        # out
        working: Working,
    ):
        """List the leaves near each leaf of the same balloon, by some threads a world."""
        world, thread = wp.tid()
        if working.near_balloons[world, working.balloon_boxes.shape[1]] == ARE_NEAR:
            for place in range(t.touch.levels[0] + thread, t.touch.levels[1], threads):
                part = t.touch.parts_by_level[place]
                balloon = four_ints_at(t.touch.parts, part)[3]
                if pays_to_look_out(t, working, world, balloon):  # few search
                    working.near_part_counts[world, part] = TOO_MANY
                else:
                    list_near_parts(t, working, world, part, balloon, pad_between(t, world, balloon, balloon))

    return find_near_parts

"""Which triangles each particle may touch, looked for every few substeps, where each piece of a substep is a launch.

Boxes lead it to them, see `touch_boxes`, in the same order every time, and in each world by itself.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.loops.meeting import FARTHEST, Place, is_nearer, skin_functions, steepness
from balloon_warp.kernels.memory import four_ints_at, int_at, vector_at
from balloon_warp.kernels.schedules.touch_boxes import (
    LOWER,
    PACE,
    SPEED,
    UPPER,
    pad_function,
    squared_distance_to_box,
)
from balloon_warp.kernels.schedules.touch_parts import lower_of_part, upper_of_part
from balloon_warp.kernels.schedules.touch_triangles import (
    candidate_of,
    faced_triangle,
    relative_speed,
    squared_distance_to_triangle,
    triangle_beside,
)
from balloon_warp.kernels.schedules.working import Working
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits

MOST_TRIANGLES = wp.constant(40)
"""that a particle keeps"""
MOST_OF_BALLOON = wp.constant(24)
"""of them, of one balloon"""
Distances = wp.types.vector(length=24, dtype=wp.float32)
ROOM = wp.constant(8)
"""for triangles that may be near, and as much for those of one more part, before they are looked at"""
Triangles = wp.types.vector(length=24, dtype=wp.int32)
Queue = wp.types.vector(length=16, dtype=wp.int32)


@wp.func
def slot_for(kept: Distances, squared: float, count: wp.int32, most: wp.int32):
    """Where among those that are kept another goes: after them, or if there are too many in the place of the farthest;
    -1 if that is it."""
    slot = count
    if count >= most:
        slot = wp.int32(-1)
        farthest = squared
        for held in range(most):
            if kept[held] > farthest:
                farthest = kept[held]
                slot = held
    return slot


@cache
def looking_functions(traits: Traits) -> tuple[Any, Any]:
    """The functions that say whether a particle may touch a triangle, and that go to the next part where it may touch
    any."""

    @wp.func
    def may_touch(t: Tables, particle: wp.int32, own: wp.int32, other: wp.int32, triangle: wp.int32):
        """A particle touches its own balloon only where that was apart at the start."""
        if wp.static(traits.touches_itself):
            if own == other:
                here = t.touch.rest_points[particle]
                apart = t.touch.apart[own]
                for corner in range(3):
                    if wp.length_sq(t.touch.rest_points[t.touch.triangles[triangle][corner]] - here) < apart * apart:
                        return False
        return True

    @wp.func
    def looks_into(
        t: Tables,
        working: Working,
        world: wp.int32,
        particle: wp.int32,
        own: wp.int32,
        other: wp.int32,
        part: wp.int32,
        point: wp.vec3,
        squared: float,
    ):
        """Whether a part may have triangles within a distance, given squared [m^2], that the particle may touch."""
        low = lower_of_part(working, world, part)
        high = upper_of_part(working, world, part)
        lower = wp.vec3(low[0], low[1], low[2])
        upper = wp.vec3(high[0], high[1], high[2])
        looks = squared_distance_to_box(point, lower, upper) <= squared
        if wp.static(traits.touches_itself):
            if looks and own == other:
                here = t.touch.rest_points[particle]
                farthest = wp.max(here - t.touch.rest_boxes[part, LOWER], t.touch.rest_boxes[part, UPPER] - here)
                looks = wp.length_sq(farthest) >= t.touch.apart[own] * t.touch.apart[own]
        return looks

    @wp.func
    def next_part(
        t: Tables,
        working: Working,
        world: wp.int32,
        particle: wp.int32,
        own: wp.int32,
        other: wp.int32,
        part: wp.int32,
        last: wp.int32,
        point: wp.vec3,
        squared: float,
    ):
        """That has no others in it, as the table has it, from a part on; all zeros if there is none. And the part after
        it."""
        node = wp.vec4i()
        while part < last and node[2] == 0:
            here = four_ints_at(t.touch.parts, part)
            after = here[0]
            if looks_into(t, working, world, particle, own, other, part, point, squared):
                after = part + 1
                if here[0] == after:
                    node = here
            part = after
        return node, part

    return may_touch, next_part


@cache
def finding_functions(traits: Traits) -> Any:
    """The function that puts the triangles of a balloon that a particle may touch into its list."""
    may_touch, next_part = looking_functions(traits)
    pad_between = pad_function(traits)
    thickness_between, _ = skin_functions(traits)

    @wp.func
    def is_one_sided(t: Tables, own: wp.int32, other: wp.int32):
        """Whether what comes behind a balloon's triangles is in it, and has to go out."""
        return other != own and t.touch.closed[other] == 1

    @wp.func
    def depth_of(t: Tables, own: wp.int32, other: wp.int32, hold: float, may_be_deep: bool):
        """How deep in a balloon a particle is looked for [m]; nothing if it is not."""
        deep = may_be_deep or wp.abs(hold) > t.touch.slack[own]
        return wp.where(deep and is_one_sided(t, own, other), t.touch.depth[other], 0.0)

    @wp.func
    def side_beside(t: Tables, world: wp.int32, own: wp.int32, other: wp.int32, hold: float, gap: float, near: float):
        """1 for a particle in front of the nearest triangle, -1 for one behind it; 0 if it is not near, nor has to go
        out."""
        side = float(1.0)
        deepest = t.touch.depth[other]
        if not is_one_sided(t, own, other):
            side = wp.where(hold < 0.0 or (hold == 0.0 and gap < 0.0), -1.0, 1.0)
            deepest = thickness_between(t, world, own, other)
        return wp.where(side * gap < near and side * gap > -deepest, side, 0.0)

    @wp.func
    def nearby(
        t: Tables,
        working: Working,
        world: wp.int32,
        particle: wp.int32,
        own: wp.int32,
        other: wp.int32,
        points: wp.array[wp.vec3],
        within: float,
        depth: float,
        beyond: float,
        most: wp.int32,
    ):
        """The nearest triangle of a balloon, or -1, and where the particle stands beside it; and those that are hardly
        farther: how many they are, which, the squares of their distances [m^2], and that of the nearest for which there
        was no room.

        In two steps, which the threads of a warp take together: the boxes of parts and of triangles say what is looked
        at, and what has been found is looked at then.

        Args:
            within: how near a triangle has to be [m], and
            depth: if none is, how near then.
            beyond: by how much others may be farther [m].
            most: of those that are kept.
        """
        point = vector_at(points, particle)
        nearest = wp.int32(-1)
        found = Place()
        steep = float(0.0)
        count = wp.int32(0)
        kept = Triangles()
        squares = Distances()
        dropped = float(FARTHEST)
        queue = Queue()
        last = int_at(t.touch.balloon_parts, other + 1)
        while nearest < 0 and within > 0.0:
            found.squared = within * within
            reach = (within + beyond) * (within + beyond)
            count = wp.int32(0)
            dropped = float(FARTHEST)
            part = int_at(t.touch.balloon_parts, other)
            while part < last:
                waiting = wp.int32(0)
                while part < last and waiting <= ROOM:
                    node, after = next_part(t, working, world, particle, own, other, part, last, point, reach)
                    part = after
                    for triangle in range(node[1], node[2]):
                        squared = squared_distance_to_triangle(t, points, triangle, point)
                        if squared <= reach and may_touch(t, particle, own, other, triangle):
                            queue[waiting] = triangle
                            waiting += 1
                for turn in range(waiting):
                    triangle = queue[turn]
                    place = triangle_beside(t, points, triangle, point)
                    if place.squared <= reach:
                        slot = slot_for(squares, place.squared, count, most)
                        if count >= most:
                            dropped = wp.min(dropped, wp.where(slot >= 0, squares[wp.max(slot, 0)], place.squared))
                        if slot >= 0:
                            kept[slot] = triangle
                            squares[slot] = place.squared
                            count = wp.max(count, slot + 1)
                    its_steep = steepness(place)
                    if is_nearer(place.squared, its_steep, found.squared, steep):
                        found = place
                        steep = its_steep
                        nearest = triangle
                        distance = wp.sqrt(place.squared) + beyond
                        reach = wp.min(reach, distance * distance)
            within = wp.where(depth > within, depth, 0.0)
        return nearest, found, count, kept, squares, dropped

    @wp.func
    def find_of_balloon(
        t: Tables,
        state: WorldState,
        working: Working,
        world: wp.int32,
        particle: wp.int32,
        own: wp.int32,
        other: wp.int32,
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
        may_be_deep: bool,
        count: wp.int32,
    ):
        """How many there are in the list then: the nearest, and those that may become it until the next search.

        Args:
            may_be_deep: whether the particle may be deep in the other balloon since the start.
        """
        velocity = vector_at(velocities, particle)
        hold = state.holds[world, particle][3]
        pad = pad_between(t, world, own, other)
        swept = t.touch.seconds * (wp.length(velocity) + working.balloon_boxes[world, other, PACE][SPEED])
        most = wp.min(MOST_OF_BALLOON, MOST_TRIANGLES - count)
        depth = depth_of(t, own, other, hold, may_be_deep)
        nearest, place, keeps, kept, squares, dropped = nearby(
            t, working, world, particle, own, other, points, pad + swept, depth, pad + 2.0 * swept, most
        )
        if nearest >= 0:
            place = faced_triangle(t, points, nearest, place)
            if is_one_sided(t, own, other) and may_be_deep and place.gap < 0.0:
                state.deep[world, particle] = wp.int8(1)  # until it is out
            comes = t.touch.seconds * relative_speed(t, velocities, nearest, velocity)
            side = side_beside(t, world, own, other, hold, place.gap, pad + comes)
            if side != 0.0:
                beside = wp.sqrt(place.squared) + pad + 2.0 * comes
                if dropped <= beside * beside:
                    wp.atomic_add(working.crowded, world, 1)
                first = count
                for slot in range(keeps):
                    if squares[slot] <= beside * beside:
                        candidate = candidate_of(kept[slot], side < 0.0, count == first)
                        working.candidates[world, particle, count] = candidate
                        count += 1
        return count

    return find_of_balloon

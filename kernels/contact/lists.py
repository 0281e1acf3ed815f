"""Narrow phase: triangles that each particle may touch, searched every few substeps.

Each piece of a substep is a launch. Bounding boxes lead a particle to the triangles, see `contact.boxes`, in the same
order every time, and in each world by itself.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.boxes import (
    LOWER,
    PACE,
    SPEED,
    UPPER,
    pad_function,
    squared_distance_to_box,
)
from balloon_warp.kernels.contact.parts import lower_of_part, upper_of_part
from balloon_warp.kernels.contact.triangles import (
    candidate_of,
    faced_triangle,
    relative_speed,
    squared_distance_to_triangle,
    triangle_beside,
)
from balloon_warp.kernels.loops.meeting import Place, is_nearer, skin_functions
from balloon_warp.kernels.memory import four_ints_at, int_at, vector_at
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.working import Working

MOST_TRIANGLES = wp.constant(40)
"""Largest number of triangles that a particle keeps"""
MOST_OF_BALLOON = wp.constant(24)
"""Largest number of triangles of one balloon that a particle keeps"""
Distances = wp.types.vector(length=24, dtype=wp.float32)
ROOM = wp.constant(8)
"""Buffer size for triangles that may be near, and for those of one more part, before they are tested"""
Queue = wp.types.vector(length=16, dtype=wp.int32)


@wp.func
def slot_for(working: Working, world: wp.int32, kept: Distances, squared: float, count: wp.int32, most: wp.int32):
    """Return the slot of a triangle among a balloon's: the next one, or the farthest one's; -1 if none is farther."""
    slot = count
    if count >= most:
        wp.atomic_add(working.crowded, world, 1)
        slot = wp.int32(-1)
        farthest = squared
        for held in range(most):
            if kept[held] > farthest:
                farthest = kept[held]
                slot = held
    return slot


@wp.struct
class Nearby:
    """Triangles found near a particle."""

    nearest: wp.int32  # triangle; -1 if there is none
    place: Place  # beside that
    count: wp.int32  # triangles in the particle's list


@cache
def may_touch_function(traits: Traits) -> Any:
    """Return the function that tells whether a particle may touch a triangle of its own balloon."""

    @wp.func
    def may_touch(t: Tables, particle: wp.int32, own: wp.int32, other: wp.int32, triangle: wp.int32):
        """Return whether a particle may touch a triangle of its own balloon: only if they were apart at the start."""
        if wp.static(traits.touches_itself):
            if own == other:
                here = t.touch.rest_points[particle]
                apart = t.touch.apart[own]
                for corner in range(3):
                    if wp.length_sq(t.touch.rest_points[t.touch.triangles[triangle][corner]] - here) < apart * apart:
                        return False
        return True

    return may_touch


@cache
def looks_function(traits: Traits) -> Any:
    """Return the function that tells whether a part may have triangles that a particle may touch."""

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
        """Return whether a part may have triangles within a squared distance [m^2] that the particle may touch."""
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

    return looks_into


@cache
def nearby_function(traits: Traits, lists: bool) -> Any:
    """Return the function that loops over the triangles of a balloon that a particle may touch.

    Args:
        lists: whether it puts them into the particle's list, of too many the nearest; else it finds the nearest.
    """
    may_touch, looks_into = may_touch_function(traits), looks_function(traits)

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
        behind: bool,
        count: wp.int32,
    ):
        """Find triangles of another balloon, or of the particle's own, within a distance [m].

        In two steps, which the threads of a warp take together: boxes of parts and of triangles select candidates,
        which are then tested.

        Args:
            behind: Whether the particle is behind them, for the list.
            count: Number of triangles in the list already.
        """
        point = vector_at(points, particle)
        first = count
        most = wp.min(MOST_OF_BALLOON, MOST_TRIANGLES - first)
        kept = Distances()
        found = Nearby()
        found.nearest = wp.int32(-1)
        found.place.squared = within * within
        found.count = count
        part = int_at(t.touch.balloon_parts, other)
        last = int_at(t.touch.balloon_parts, other + 1)
        queue = Queue()
        while part < last:
            waiting = wp.int32(0)
            while part < last and waiting <= ROOM:
                node = wp.vec4i()
                while part < last and node[2] == 0:  # to the next part that has no others in it
                    here = four_ints_at(t.touch.parts, part)
                    after = here[0]
                    if looks_into(t, working, world, particle, own, other, part, point, found.place.squared):
                        after = part + 1
                        if here[0] == after:
                            node = here
                    part = after
                for triangle in range(node[1], node[2]):
                    squared = squared_distance_to_triangle(t, points, triangle, point)
                    if squared <= found.place.squared and may_touch(t, particle, own, other, triangle):
                        queue[waiting] = triangle
                        waiting += 1
            for turn in range(waiting):
                triangle = queue[turn]
                place = triangle_beside(t, points, triangle, point)
                if wp.static(lists):
                    if place.squared <= found.place.squared:
                        slot = slot_for(working, world, kept, place.squared, found.count - first, most)
                        if slot >= 0:
                            kept[slot] = place.squared
                            working.candidates[world, particle, first + slot] = candidate_of(
                                triangle, behind, slot == 0
                            )
                            found.count = wp.max(found.count, first + slot + 1)
                else:
                    if is_nearer(place, found.place):
                        found.place = place
                        found.nearest = triangle
        return found

    return nearby


@cache
def finding_functions(traits: Traits) -> Any:
    """Return the function that puts the triangles of a balloon that a particle may touch into its list."""
    pad_between = pad_function(traits)
    thickness_between, _ = skin_functions(traits)
    nearest_of = nearby_function(traits, lists=False)
    list_those = nearby_function(traits, lists=True)

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
        """Add triangles of a balloon to a particle's list, and return its length.

        Args:
            may_be_deep: Whether the particle may be deep in the other balloon since the start.
        """
        hold = state.holds[world, particle][3]
        velocity = vector_at(velocities, particle)
        pad = pad_between(t, world, own, other)
        one_sided = other != own and t.touch.closed[other] == 1
        swept = t.touch.seconds * (wp.length(velocity) + working.balloon_boxes[world, other, PACE][SPEED])
        within = pad + swept
        looks_deep = one_sided and (may_be_deep or wp.abs(hold) > t.touch.slack[own])
        found = Nearby()
        found.nearest = wp.int32(-1)
        while found.nearest < 0 and within > 0.0:
            found = nearest_of(t, working, world, particle, own, other, points, within, False, count)
            within = wp.where(looks_deep and t.touch.depth[other] > within, t.touch.depth[other], 0.0)
        if found.nearest >= 0:
            place = faced_triangle(t, points, found.nearest, found.place)
            side = float(1.0)
            deepest = t.touch.depth[other]
            if not one_sided:
                side = wp.where(hold < 0.0 or (hold == 0.0 and place.gap < 0.0), -1.0, 1.0)
                deepest = thickness_between(t, world, own, other)
            comes = t.touch.seconds * relative_speed(t, velocities, found.nearest, velocity)
            if one_sided and may_be_deep and place.gap < 0.0:
                state.deep[world, particle] = wp.int8(1)  # until it is out
            if side * place.gap < pad + comes and side * place.gap > -deepest:
                beside = wp.sqrt(place.squared) + pad + 2.0 * comes
                listed = list_those(t, working, world, particle, own, other, points, beside, side < 0.0, count)
                count = listed.count
        return count

    return find_of_balloon

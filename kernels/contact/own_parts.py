"""Parts of a balloon that touches itself: how far all are from touching each other, by where they are and how deformed.

Two parts cannot touch where the boxes around them are apart. Parts beside each other on the surface always meet by
their boxes. They cannot touch while the surface around them keeps its shape: where the placement of one part, turned
and scaled as a whole, also places the other, but for a little, places apart at the start still are.

Both bound the room that there is: how far particles may move relative to each other until any can touch. Parts are
looked at again once they have. So balloons that fly, rest or tremble are hardly ever looked at. The state keeps the
room and where it was found, so that a run that is resumed takes the same frames for free.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.free_frames import BUSY, FREE, HURRIED, FreeFrames
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import FAR_AWAY
from balloon_warp.kernels.loops.meeting import skin_functions
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import block_barrier

wp.set_module_options(OPTIONS)

LOWER, UPPER = wp.constant(0), wp.constant(1)
"""Rows of a box"""
SMALL = wp.constant(1.0e-20)
"""Length of an axis that is none"""
MOST_ROOM = wp.constant(30.0)
"""Room beyond which it need not be known, over the skin's thickness: one and a half edges"""

Ways = wp.types.vector(length=6, dtype=wp.float32)
"""Largest and negated least components of particles' ways [m]"""


@wp.func
def larger_ways(a: Ways, b: Ways):
    """Return the larger of each component."""
    return wp.max(a, b)


@wp.struct
class OwnParts:
    """Compact parts of balloons' surfaces at the start, and where they are in each world.

    A part's axes are those along which it extends most. A group is some parts after each other.
    """

    particles: wp.array[wp.int32]
    """Particles of the triangles of each part"""
    first: wp.array[wp.int32]
    """First entry of each part among these, and their number"""
    offsets: wp.array[wp.vec3]
    """Place of each particle from its part's center at the start [m]"""
    weights: wp.array[wp.vec2]
    """Weight of each particle in the images of its part's two longest axes [1/m]"""
    axes: wp.array[wp.mat33]
    """Axes of each part, a column each"""
    centers: wp.array[wp.vec3]
    """Center of each part at the start, the mean of its particles [m]"""
    sizes: wp.array[wp.vec2]
    """Radius of each part around its center at the start, and its least gap to features that it may touch [m]"""
    balloons: wp.array[wp.int32]
    """Balloon of each part"""
    groups: wp.array[wp.int32]
    """First part of each group, and the number of parts; a group is of one balloon"""
    looks: wp.array2d[wp.int32]
    """Whether a balloon's parts are to be looked at"""
    drifts: wp.array2d[wp.vec3]
    """Motion of a balloon as a whole in a frame [m]"""
    means: wp.array2d[wp.vec3]
    """Mean of each part's particles [m]"""
    maps: wp.array2d[wp.mat33]
    """Rotation and scale of each part since the start"""
    misfits: wp.array2d[float]
    """Largest distance of a particle from where these place it [m]"""
    boxes: wp.array3d[wp.vec3]
    """Box of each part [m]; after a frame also around where it was before, but for the drift"""
    group_boxes: wp.array3d[wp.vec3]
    """Box of each group, which has those of its parts [m]"""


@wp.kernel(enable_backward=False)
def see_straying(
    # model
    t: Tables,
    # in
    verdicts: wp.array[wp.int32],
    state: WorldState,
    before: WorldState,
    # state in and out
    seen_points: wp.array2d[wp.vec3],
    rooms: wp.array2d[float],
    # out
    own: OwnParts,
):
    """Find the balloons whose particles may have moved farther than there was room; a block a (world, balloon).

    Args:
        before: Where the frame began, or the state itself where it begins.
    """
    world, balloon, thread = wp.tid()
    begin = t.particles.offsets[balloon]
    end = t.particles.offsets[balloon + 1]
    ways = Ways(-FAR_AWAY)
    drift = wp.vec3()
    for particle in range(begin + thread, end, wp.block_dim()):
        point = state.points[world, particle]
        way = point - seen_points[world, particle]
        ways = wp.max(ways, Ways(way[0], way[1], way[2], -way[0], -way[1], -way[2]))
        drift += point - before.points[world, particle]
    most = wp.tile_reduce(larger_ways, wp.tile(ways, preserve_type=True))[0]
    drifts = wp.tile_sum(wp.tile(drift, preserve_type=True))[0]
    strays = wp.length(wp.vec3(most[0] + most[3], most[1] + most[4], most[2] + most[5]))
    looks = verdicts[world] == FREE and not strays < rooms[world, balloon]  # or it is no number
    block_barrier()  # all have read the room
    if thread == 0:
        own.looks[world, balloon] = wp.where(looks, 1, 0)
        own.drifts[world, balloon] = drifts / float(wp.max(end - begin, 1))
        if looks:
            rooms[world, balloon] = MOST_ROOM * t.touch.thickness[balloon]
    if looks:
        for particle in range(begin + thread, end, wp.block_dim()):
            seen_points[world, particle] = state.points[world, particle]


@wp.func
def place_part(own: OwnParts, world: wp.int32, part: wp.int32, points: wp.array2d[wp.vec3],
               before: wp.array2d[wp.vec3], drift: wp.vec3):  # fmt: skip
    """Find where a part is: its mean, rotation, scale, misfit and box."""
    begin = own.first[part]
    end = own.first[part + 1]
    lower = wp.vec3(FAR_AWAY)
    upper = wp.vec3(-FAR_AWAY)
    mean = wp.vec3()
    first = wp.vec3()
    second = wp.vec3()
    for place in range(begin, end):
        particle = own.particles[place]
        point = points[world, particle]
        start = before[world, particle] + drift
        lower = wp.min(lower, wp.min(point, start))
        upper = wp.max(upper, wp.max(point, start))
        mean += point
        weight = own.weights[place]
        first += weight[0] * point
        second += weight[1] * point
    mean /= float(end - begin)
    # weights sum up to zero, so that these are images of two axes
    length = wp.length(first)
    first = first / wp.max(length, SMALL)
    second = second - wp.dot(second, first) * first
    width = wp.length(second)
    second = second / wp.max(width, SMALL)
    turn = wp.matrix_from_cols(first, second, wp.cross(first, second)) * wp.transpose(own.axes[part])
    turn = 0.5 * (length + width) * turn
    squared = float(0.0)
    for place in range(begin, end):
        strays = points[world, own.particles[place]] - mean - turn * own.offsets[place]
        squared = wp.max(squared, wp.length_sq(strays))
    own.means[world, part] = mean
    own.maps[world, part] = turn
    own.misfits[world, part] = wp.where(width > SMALL, wp.sqrt(squared), FAR_AWAY)
    own.boxes[world, part, LOWER] = lower
    own.boxes[world, part, UPPER] = upper


@wp.kernel(enable_backward=False)
def place_parts(
    # in
    state: WorldState,
    before: WorldState,
    # out
    own: OwnParts,
):
    """Find where all parts are; a thread a part."""
    world, part = wp.tid()
    balloon = own.balloons[part]
    if own.looks[world, balloon] == 1:
        place_part(own, world, part, state.points, before.points, own.drifts[world, balloon])


@wp.kernel(enable_backward=False)
def box_groups(own: OwnParts):
    """Find the boxes of groups; a thread a group."""
    world, group = wp.tid()
    if own.looks[world, own.balloons[own.groups[group]]] == 1:
        lower = wp.vec3(FAR_AWAY)
        upper = wp.vec3(-FAR_AWAY)
        for part in range(own.groups[group], own.groups[group + 1]):
            lower = wp.min(lower, own.boxes[world, part, LOWER])
            upper = wp.max(upper, own.boxes[world, part, UPPER])
        own.group_boxes[world, group, LOWER] = lower
        own.group_boxes[world, group, UPPER] = upper


@wp.func
def gap_between(boxes: wp.array3d[wp.vec3], world: wp.int32, first: wp.int32, second: wp.int32):
    """Return the largest distance of two boxes along an axis [m]; negative where they overlap."""
    below = boxes[world, first, LOWER] - boxes[world, second, UPPER]
    above = boxes[world, second, LOWER] - boxes[world, first, UPPER]
    return wp.max(wp.max(below, above))


@wp.func
def least_between(own: OwnParts, world: wp.int32, one: wp.int32, other: wp.int32):
    """Return a bound on how near a particle or edge of a part is to one of another that it may touch [m]."""
    first = wp.where(own.sizes[one][0] < own.sizes[other][0], other, one)
    second = one + other - first
    way = own.centers[second] - own.centers[first]
    between = wp.length(way) - own.sizes[first][0] - own.sizes[second][0]
    least = wp.max(between, wp.max(own.sizes[first][1], own.sizes[second][1]))
    turn = own.maps[world, first]
    scale = wp.length(turn * wp.vec3(1.0, 0.0, 0.0))
    strays = own.misfits[world, first] + own.misfits[world, second]
    if first != second:
        # by how much the first's placement misplaces the second's center, and its particles around that
        strays += wp.length(own.means[world, second] - own.means[world, first] - turn * way)
        change = own.maps[world, second] - turn
        strays += wp.sqrt(wp.ddot(change, change)) * own.sizes[second][0]
    return scale * least - strays


@cache
def judge_parts_kernel(features: Features) -> Any:
    """Return the kernel that finds the room between parts, and whether there is any."""
    thickness_between = skin_functions(features)[0]

    @wp.func
    def room_of_group(own: OwnParts, world: wp.int32, group: wp.int32, pad: float, most: float):
        """Return the room of a group's parts to each other, and to those of groups after it [m].

        Args:
            pad: Distance at which there is none [m].
            most: Largest that need be known [m].
        """
        room = float(most)
        balloon = own.balloons[own.groups[group]]
        other = wp.int32(group)
        while other < own.groups.shape[0] - 1 and room > 0.0:
            same = own.balloons[own.groups[other]] == balloon
            if same and gap_between(own.group_boxes, world, group, other) - pad < room:
                for first in range(own.groups[group], own.groups[group + 1]):
                    for second in range(wp.max(first, own.groups[other]), own.groups[other + 1]):
                        gap = gap_between(own.boxes, world, first, second)
                        if gap - pad < room:
                            room = wp.min(room, wp.max(gap, least_between(own, world, first, second)) - pad)
            other += 1
        return room

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def judge_parts(
        # model
        t: Tables,
        # in
        own: OwnParts,
        is_over: wp.int32,
        # state in and out
        rooms: wp.array2d[float],
        # in and out
        free: FreeFrames,
    ):
        """Judge whether parts may touch in a frame; a thread a group.

        Args:
            is_over: Whether the frame is over, and was taken to be free.
        """
        world, group = wp.tid()
        balloon = own.balloons[own.groups[group]]
        if own.looks[world, balloon] == 1:
            pad = thickness_between(t, world, balloon, balloon) + 2.0 * t.touch.slack[balloon]
            room = room_of_group(own, world, group, pad, MOST_ROOM * t.touch.thickness[balloon])
            wp.atomic_min(rooms, world, balloon, room)
            if not room > 0.0:  # or it is no number
                wp.atomic_min(rooms, world, balloon, 0.0)
                free.verdicts[world] = wp.where(is_over == 1, HURRIED, BUSY)
                free.any_busy[0] = 1

    return judge_parts

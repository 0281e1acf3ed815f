"""Boxes around what balloons, and parts of them, sweep until the next search: which may touch at all."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.loops.meeting import skin_functions
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.schedules.launched import Working
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits

wp.set_module_options(OPTIONS)

LOWER, UPPER, SPEED = wp.constant(0), wp.constant(1), wp.constant(2)
"""what of a box stands where"""
APART, WAS_NEAR, ARE_NEAR = wp.constant(0), wp.constant(1), wp.constant(2)
"""what there is to do in a world: nothing, to forget what was near, or to look"""


@wp.func
def sweep_of(
    t: Tables,
    balloon: wp.int32,
    first: wp.int32,
    step: wp.int32,
    points: wp.array[wp.vec3],
    velocities: wp.array[wp.vec3],
):
    """What each so-manyth particle of a balloon sweeps until the next search: the corners of the box around it [m], and
    the square of the highest speed [m^2/s^2]."""
    lower = wp.vec3(1.0e30)
    upper = wp.vec3(-1.0e30)
    fastest = float(0.0)
    for particle in range(t.particles.offsets[balloon] + first, t.particles.offsets[balloon + 1], step):
        here = points[particle]
        way = t.touch.seconds * velocities[particle]
        lower = wp.min(lower, wp.min(here, here + way))
        upper = wp.max(upper, wp.max(here, here + way))
        fastest = wp.max(fastest, wp.length_sq(velocities[particle]))
    return lower, upper, fastest


@wp.kernel(enable_backward=False)
def box_balloons(
    # model
    t: Tables,
    # state in
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    # out
    working: Working,
):
    """A block a (world, balloon): the box around its particles until the next search, and their highest speed."""
    world, balloon, thread = wp.tid()
    lower, upper, fastest = sweep_of(t, balloon, thread, wp.block_dim(), points[world], velocities[world])
    x = wp.tile_min(wp.tile(lower[0]))[0]
    y = wp.tile_min(wp.tile(lower[1]))[0]
    z = wp.tile_min(wp.tile(lower[2]))[0]
    x_end = wp.tile_max(wp.tile(upper[0]))[0]
    y_end = wp.tile_max(wp.tile(upper[1]))[0]
    z_end = wp.tile_max(wp.tile(upper[2]))[0]
    speed = wp.tile_max(wp.tile(fastest))[0]
    if thread == 0:
        working.balloon_boxes[world, balloon, LOWER] = wp.vec3(x, y, z)
        working.balloon_boxes[world, balloon, UPPER] = wp.vec3(x_end, y_end, z_end)
        working.balloon_boxes[world, balloon, SPEED] = wp.vec3(wp.sqrt(speed))


@wp.func
def boxes_meet(lower: wp.vec3, upper: wp.vec3, other_lower: wp.vec3, other_upper: wp.vec3, pad: float):
    """Whether they come as near as that in each direction [m]."""
    gap = wp.max(lower - other_upper, other_lower - upper)
    return wp.max(gap) <= pad


@wp.func
def squared_distance_to_box(point: wp.vec3, lower: wp.vec3, upper: wp.vec3):
    """[m^2]"""
    return wp.length_sq(wp.max(wp.max(lower - point, point - upper), wp.vec3()))


@cache
def pad_function(traits: Traits) -> Any:
    """The function that says how near two balloons' particles and triangles have to be, beside what they sweep [m]."""
    thickness_between, _ = skin_functions(traits)

    @wp.func
    def pad_between(t: Tables, world: wp.int32, first: wp.int32, second: wp.int32):
        return thickness_between(t, world, first, second) + t.touch.slack[first] + t.touch.slack[second]

    return pad_between


@cache
def meet_function(traits: Traits) -> Any:
    """The function that says whether a balloon may meet any."""
    pad_between = pad_function(traits)

    @wp.func
    def may_meet(t: Tables, working: Working, world: wp.int32, balloon: wp.int32):
        near = bool(wp.static(traits.touches_itself))
        for other in range(working.balloon_boxes.shape[1]):
            near = near or (
                other != balloon
                and boxes_meet(
                    working.balloon_boxes[world, balloon, LOWER],
                    working.balloon_boxes[world, balloon, UPPER],
                    working.balloon_boxes[world, other, LOWER],
                    working.balloon_boxes[world, other, UPPER],
                    pad_between(t, world, balloon, other),
                )
            )
        return near

    return may_meet


@wp.func
def what_to_do(before: wp.int32, near: bool):
    """In a world whose balloons are near each other, or none, after what there was to do until now."""
    return wp.where(near, ARE_NEAR, wp.where(before == ARE_NEAR, WAS_NEAR, APART))


@wp.func
def forget_lists(working: Working, world: wp.int32):
    """Of particles, see `touch_search`, and of edges, see `launched_edges`."""
    for which in range(3):
        working.list_lengths[world, which] = 0


@cache
def meet_kernel(traits: Traits) -> Any:
    """The kernel that says which balloons may meet."""
    may_meet = meet_function(traits)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def meet_balloons(
        # model
        t: Tables,
        # in and out
        working: Working,
    ):
        """A thread a world."""
        world = wp.tid()
        balloons = working.balloon_boxes.shape[1]
        any_near = bool(False)
        for balloon in range(balloons):
            near = may_meet(t, working, world, balloon)
            working.near_balloons[world, balloon] = wp.where(near, 1, 0)
            any_near = any_near or near
        forget_lists(working, world)
        working.near_balloons[world, balloons] = what_to_do(working.near_balloons[world, balloons], any_near)

    return meet_balloons


@wp.func
def is_whole(t: Tables, part: wp.int32):
    """Whether there are no parts in a part."""
    return t.touch.part_ends[part] == part + 1


@wp.func
def box_part(
    t: Tables,
    working: Working,
    world: wp.int32,
    part: wp.int32,
    of_whole: wp.int32,
    points: wp.array[wp.vec3],
    velocities: wp.array[wp.vec3],
):
    """The box around a part, if its balloon may meet any, and if it is one of those that are asked for, see
    `box_parts`."""
    own = t.touch.part_triangles[part]
    near = bool(False)
    if own[1] > own[0]:  # what has no faces, but edges, has no triangles
        balloon = t.particles.balloon[t.touch.triangles[own[0]][0]]
        near = working.near_balloons[world, balloon] == 1
    if near and is_whole(t, part) == (of_whole == 1):
        lower = wp.vec3(1.0e30)
        upper = wp.vec3(-1.0e30)
        if of_whole == 1:
            for place in range(t.touch.part_particles[part][0], t.touch.part_particles[part][1]):
                particle = t.touch.particles[place]
                here = points[particle]
                way = t.touch.seconds * velocities[particle]
                lower = wp.min(lower, wp.min(here, here + way))
                upper = wp.max(upper, wp.max(here, here + way))
        else:
            for inner in range(part + 1, t.touch.part_ends[part]):
                if is_whole(t, inner):
                    lower = wp.min(lower, working.part_boxes[world, inner, LOWER])
                    upper = wp.max(upper, working.part_boxes[world, inner, UPPER])
        working.part_boxes[world, part, LOWER] = lower
        working.part_boxes[world, part, UPPER] = upper


@wp.kernel(enable_backward=False)
def box_parts(
    # model
    t: Tables,
    threads: wp.int32,
    of_whole: wp.int32,
    # state in
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    # out
    working: Working,
):
    """Some threads a world: boxes around the parts of balloons that may meet others.

    Args:
        of_whole: whether of those that have no others in them, which come first: the others' are made of theirs.
    """
    world, thread = wp.tid()
    balloons = working.balloon_boxes.shape[1]
    if working.near_balloons[world, balloons] == ARE_NEAR:
        for part in range(thread, t.touch.part_ends.shape[0], threads):
            box_part(t, working, world, part, of_whole, points[world], velocities[world])

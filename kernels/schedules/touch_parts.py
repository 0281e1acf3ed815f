"""Boxes around what parts of balloons sweep until the next search: they lead a particle to the triangles near it."""

import warp as wp

from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.schedules.launched import Working
from balloon_warp.kernels.schedules.touch_boxes import ALONE, ARE_NEAR, LOWER, UPPER
from balloon_warp.kernels.tables import Tables

wp.set_module_options(OPTIONS)


@wp.func
def is_whole(t: Tables, part: wp.int32):
    """Whether there are no parts in a part."""
    return t.touch.part_ends[part] == part + 1


@wp.func
def is_boxed(t: Tables, working: Working, world: wp.int32, part: wp.int32):
    """Whether a part's balloon may meet any. What has no faces, but edges, has no triangles."""
    own = t.touch.part_triangles[part]
    near = bool(False)
    if own[1] > own[0]:
        balloon = t.particles.balloon[t.touch.triangles[own[0]][0]]
        near = working.near_balloons[world, balloon] != ALONE
    return near


@wp.func
def box_whole_part(
    t: Tables,
    working: Working,
    world: wp.int32,
    part: wp.int32,
    points: wp.array[wp.vec3],
    velocities: wp.array[wp.vec3],
):
    """The box around a part that has no others in it."""
    lower = wp.vec3(1.0e30)
    upper = wp.vec3(-1.0e30)
    for place in range(t.touch.part_particles[part][0], t.touch.part_particles[part][1]):
        particle = t.touch.particles[place]
        here = points[particle]
        way = t.touch.seconds * velocities[particle]
        lower = wp.min(lower, wp.min(here, here + way))
        upper = wp.max(upper, wp.max(here, here + way))
    working.part_boxes[world, part, LOWER] = lower
    working.part_boxes[world, part, UPPER] = upper


@wp.func
def box_of_parts(t: Tables, working: Working, world: wp.int32, part: wp.int32, first: wp.int32, step: wp.int32):
    """The corners of the box around each so-manyth of those in a part."""
    lower = wp.vec3(1.0e30)
    upper = wp.vec3(-1.0e30)
    for inner in range(part + 1 + first, t.touch.part_ends[part], step):
        if is_whole(t, inner):
            lower = wp.min(lower, working.part_boxes[world, inner, LOWER])
            upper = wp.max(upper, working.part_boxes[world, inner, UPPER])
    return lower, upper


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
            if is_boxed(t, working, world, part) and is_whole(t, part) == (of_whole == 1):
                if of_whole == 1:
                    box_whole_part(t, working, world, part, points[world], velocities[world])
                else:
                    lower, upper = box_of_parts(t, working, world, part, 0, 1)
                    working.part_boxes[world, part, LOWER] = lower
                    working.part_boxes[world, part, UPPER] = upper

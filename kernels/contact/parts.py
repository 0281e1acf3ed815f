"""Boxes around the sweeps of parts of balloons until the next search: they lead a particle to the triangles near it."""

import warp as wp

from balloon_warp.kernels.contact.boxes import ALONE, ARE_NEAR
from balloon_warp.kernels.memory import four_in, four_ints_at, int_at, int_pair_at, put_four_in, vector_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.warps import block_barrier
from balloon_warp.kernels.working import Working

wp.set_module_options(OPTIONS)


@wp.func
def lower_of_part(working: Working, world: wp.int32, part: wp.int32):
    """Return the lower corner of a part's box [m]; the fourth component is unused."""
    return four_in(working.part_boxes, world, 2 * part)


@wp.func
def upper_of_part(working: Working, world: wp.int32, part: wp.int32):
    """Return the upper corner of a part's box [m]."""
    return four_in(working.part_boxes, world, 2 * part + 1)


@wp.func
def put_box_of_part(working: Working, world: wp.int32, part: wp.int32, lower: wp.vec4, upper: wp.vec4):
    """Store both corners of a part's box."""
    put_four_in(working.part_boxes, world, 2 * part, lower)
    put_four_in(working.part_boxes, world, 2 * part + 1, upper)


@wp.func
def is_boxed(working: Working, world: wp.int32, node: wp.vec4i):
    """Return whether a part's balloon may touch any.

    Balloons without faces, but with edges, have no triangles.
    """
    return node[2] > node[1] and working.near_balloons[world, node[3]] != ALONE


@wp.struct
class Swept:
    """Box around the sweep of an edge or a part until the next search [m]."""

    lower: wp.vec3
    upper: wp.vec3


@wp.func
def box_of_part(working: Working, world: wp.int32, part: wp.int32):
    """Return the box around the sweep of a part."""
    lower = lower_of_part(working, world, part)
    upper = upper_of_part(working, world, part)
    swept = Swept()
    swept.lower = wp.vec3(lower[0], lower[1], lower[2])
    swept.upper = wp.vec3(upper[0], upper[1], upper[2])
    return swept


@wp.func
def swept_by_edge(t: Tables, ends: wp.vec2i, points: wp.array[wp.vec3], velocities: wp.array[wp.vec3]):
    """Return the box around the sweep of an edge."""
    a = vector_at(points, ends[0])
    b = vector_at(points, ends[1])
    after_a = a + t.touch.seconds * vector_at(velocities, ends[0])
    after_b = b + t.touch.seconds * vector_at(velocities, ends[1])
    swept = Swept()
    swept.lower = wp.min(wp.min(a, b), wp.min(after_a, after_b))
    swept.upper = wp.max(wp.max(a, b), wp.max(after_a, after_b))
    return swept


@wp.func
def box_of_edge(working: Working, world: wp.int32, edge: wp.int32):
    """Return the stored box around the sweep of an edge."""
    lower = four_in(working.edge_boxes, world, 2 * edge)
    upper = four_in(working.edge_boxes, world, 2 * edge + 1)
    swept = Swept()
    swept.lower = wp.vec3(lower[0], lower[1], lower[2])
    swept.upper = wp.vec3(upper[0], upper[1], upper[2])
    return swept


@wp.func
def put_box_of_edge(working: Working, world: wp.int32, edge: wp.int32, swept: Swept):
    """Store the box of an edge: many others will compare theirs with it."""
    lower, upper = swept.lower, swept.upper
    put_four_in(working.edge_boxes, world, 2 * edge, wp.vec4(lower[0], lower[1], lower[2], 0.0))
    put_four_in(working.edge_boxes, world, 2 * edge + 1, wp.vec4(upper[0], upper[1], upper[2], 0.0))


@wp.func
def box_whole_part(
    t: Tables,
    working: Working,
    world: wp.int32,
    part: wp.int32,
    points: wp.array[wp.vec3],
    velocities: wp.array[wp.vec3],
):
    """Build the box of a leaf."""
    lower = wp.vec3(1.0e30)
    upper = wp.vec3(-1.0e30)
    own = int_pair_at(t.touch.part_particles, part)
    for place in range(own[0], own[1]):
        particle = int_at(t.touch.particles, place)
        here = vector_at(points, particle)
        there = here + t.touch.seconds * vector_at(velocities, particle)
        lower = wp.min(lower, wp.min(here, there))
        upper = wp.max(upper, wp.max(here, there))
    put_box_of_part(
        working, world, part,
        wp.vec4(lower[0], lower[1], lower[2], 0.0), wp.vec4(upper[0], upper[1], upper[2], 0.0),
    )  # fmt: skip


@wp.func
def box_both_halves(working: Working, world: wp.int32, part: wp.int32, second: wp.int32):
    """Build the box of a part from those of its two children; the first is the next part."""
    put_box_of_part(
        working, world, part,
        wp.min(lower_of_part(working, world, part + 1), lower_of_part(working, world, second)),
        wp.max(upper_of_part(working, world, part + 1), upper_of_part(working, world, second)),
    )  # fmt: skip


@wp.func
def box_parts(
    t: Tables,
    working: Working,
    world: wp.int32,
    thread: wp.int32,
    threads: wp.int32,
    points: wp.array[wp.vec3],
    velocities: wp.array[wp.vec3],
):
    """Build boxes around the parts of balloons that may touch others, by all threads of a block.

    It goes level by level from the leaves.
    """
    for level in range(t.touch.levels.shape[0] - 1):
        for place in range(t.touch.levels[level] + thread, t.touch.levels[level + 1], threads):
            part = t.touch.parts_by_level[place]
            node = four_ints_at(t.touch.parts, part)
            if is_boxed(working, world, node):
                if level == 0:
                    box_whole_part(t, working, world, part, points, velocities)
                else:
                    box_both_halves(working, world, part, four_ints_at(t.touch.parts, part + 1)[0])
        block_barrier()


@wp.kernel(enable_backward=False)
def box_parts_of_worlds(
    # model
    t: Tables,
    # state in
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    # out
    working: Working,
):
    """Build the boxes of parts; a block a world."""
    world, thread = wp.tid()
    if working.near_balloons[world, working.balloon_boxes.shape[1]] == ARE_NEAR:
        box_parts(t, working, world, thread, wp.block_dim(), points[world], velocities[world])

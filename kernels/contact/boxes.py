"""Bounding boxes of balloons, and of leaves of a few triangles, swept until the next search.

Leaves that follow each other lie together. Rows of them have boxes, too: so a search skips most. On a GPU the threads
of a warp share a row, and each tests a leaf; a CPU tests eight boxes at once in its vector registers. There the boxes
of triangles are made when a search first looks into their leaf.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import FAR_AWAY
from balloon_warp.kernels.loops.contact import skin_functions
from balloon_warp.kernels.memory import four_in, int_at, int_pair_at, put_four_in, vector_at
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.warps import any_in_block, any_in_warp, thread_of_warp, votes_of_warp, warp_max
from balloon_warp.kernels.working import EightBoxes, Working

wp.set_module_options(OPTIONS)
LOWER, UPPER, PACE = wp.constant(0), wp.constant(1), wp.constant(2)
"""Rows of a box"""
SPEED, STRAYED, MOVED = wp.constant(0), wp.constant(1), wp.constant(2)
"""Entries of `PACE`: the highest speed [m/s], whether a particle has strayed, see `Sweep`, and the longest way that one
has moved since it was looked for [m]"""
APART, WAS_NEAR, ARE_NEAR, STILL_NEAR = wp.constant(0), wp.constant(1), wp.constant(2), wp.constant(3)
"""Work in a world: none, clear the lists of near balloons, search, or reuse the last lists"""
ALONE, KNOWN, SEARCHES = wp.constant(0), wp.constant(1), wp.constant(2)
"""Work of a balloon's particles: none, since no balloon is near; reuse their last lists; or search"""
SPARE = wp.constant(0.25)
"""Fraction of a balloon's slack that its particles may move before a new search. Another balloon may move as much, and
both as much before as after one of them was searched; so half of the slack is left for their way by
acceleration"""


@wp.struct
class Sweep:
    """Bounds on particles until the next search."""

    lower: wp.vec3  # corners of the box around it [m]
    upper: wp.vec3
    fastest: float  # square of the highest speed [m^2/s^2]
    strayed: float  # the longest way from where a particle was looked for to where it will be [m]
    moved: float  # the longest way from there to where it is [m]


@wp.func
def sweep_of(
    t: Tables,
    balloon: wp.int32,
    first: wp.int32,
    step: wp.int32,
    points: wp.array[wp.vec3],
    velocities: wp.array[wp.vec3],
    sought: wp.array[wp.vec3],
):
    """Return the bounds on every n-th particle of a balloon.

    Args:
        sought: Positions at the last search [m].
    """
    sweep = Sweep()
    sweep.lower = wp.vec3(1.0e30)
    sweep.upper = wp.vec3(-1.0e30)
    for particle in range(t.particles.offsets[balloon] + first, t.particles.offsets[balloon + 1], step):
        here = points[particle]
        way = t.touch.seconds * velocities[particle]
        sweep.lower = wp.min(sweep.lower, wp.min(here, here + way))
        sweep.upper = wp.max(sweep.upper, wp.max(here, here + way))
        sweep.fastest = wp.max(sweep.fastest, wp.length_sq(velocities[particle]))
        moved = wp.length(here - sought[particle])
        sweep.strayed = wp.max(sweep.strayed, moved + wp.length(way))
        sweep.moved = wp.max(sweep.moved, moved)
    return sweep


@wp.func
def is_known(working: Working, world: wp.int32):
    """Test for valid lists of near balloons."""
    before = working.near_balloons[world, working.balloon_boxes.shape[1]]
    return before >= ARE_NEAR


@wp.func
def put_sweep(t: Tables, working: Working, world: wp.int32, balloon: wp.int32, sweep: Sweep, is_first: bool):
    """Store the bounds of a balloon's particles.

    Args:
        is_first: Whether a frame begins, with a state that may be another's.
    """
    strayed = is_first or not is_known(working, world) or sweep.strayed > SPARE * t.touch.slack[balloon]
    working.balloon_boxes[world, balloon, LOWER] = sweep.lower
    working.balloon_boxes[world, balloon, UPPER] = sweep.upper
    working.balloon_boxes[world, balloon, PACE] = wp.vec3(
        wp.sqrt(sweep.fastest), wp.where(strayed, 1.0, 0.0), sweep.moved
    )


@wp.kernel(enable_backward=False)
def box_balloons(
    # model
    t: Tables,
    # state in
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    is_first: wp.int32,
    # in and out
    working: Working,
):
    """Compute the bounds that the particles of a balloon sweep until the next search; a block a (world, balloon)."""
    world, balloon, thread = wp.tid()
    own = sweep_of(t, balloon, thread, wp.block_dim(), points[world], velocities[world], working.sought[world])
    sweep = Sweep()
    x = wp.tile_min(wp.tile(own.lower[0]))[0]
    y = wp.tile_min(wp.tile(own.lower[1]))[0]
    z = wp.tile_min(wp.tile(own.lower[2]))[0]
    sweep.lower = wp.vec3(x, y, z)
    x = wp.tile_max(wp.tile(own.upper[0]))[0]
    y = wp.tile_max(wp.tile(own.upper[1]))[0]
    z = wp.tile_max(wp.tile(own.upper[2]))[0]
    sweep.upper = wp.vec3(x, y, z)
    sweep.fastest = wp.tile_max(wp.tile(float(own.fastest)))[0]
    sweep.strayed = wp.tile_max(wp.tile(float(own.strayed)))[0]
    sweep.moved = wp.tile_max(wp.tile(float(own.moved)))[0]
    if thread == 0:
        put_sweep(t, working, world, balloon, sweep, is_first == 1)


@wp.func
def boxes_meet(lower: wp.vec3, upper: wp.vec3, other_lower: wp.vec3, other_upper: wp.vec3, pad: float):
    """Return whether two boxes are within a distance in each direction [m]."""
    gap = wp.max(lower - other_upper, other_lower - upper)
    return wp.max(gap) <= pad


@wp.func
def squared_distance_to_box(point: wp.vec3, lower: wp.vec3, upper: wp.vec3):
    """Return the squared distance of a point to a box [m^2]."""
    return wp.length_sq(wp.max(wp.max(lower - point, point - upper), wp.vec3()))


@cache
def pad_function(features: Features) -> Any:
    """Return the function for the distance at which particles and triangles of two balloons are near [m].

    The distance excludes their own ways.
    """
    thickness_between, _ = skin_functions(features)

    @wp.func
    def pad_between(t: Tables, world: wp.int32, first: wp.int32, second: wp.int32):
        return thickness_between(t, world, first, second) + t.touch.slack[first] + t.touch.slack[second]

    return pad_between


@cache
def nearing_function(features: Features) -> Any:
    """Filter of balloons that a particle may touch until the next search."""
    pad_between = pad_function(features)

    @wp.func
    def is_nearing(
        t: Tables,
        working: Working,
        world: wp.int32,
        balloon: wp.int32,
        other: wp.int32,
        point: wp.vec3,
        velocity: wp.vec3,
    ):
        """Return whether a particle may come near another balloon, by the box that the balloon sweeps."""
        end = point + t.touch.seconds * velocity
        lower = working.balloon_boxes[world, other, LOWER]
        upper = working.balloon_boxes[world, other, UPPER]
        pad = pad_between(t, world, balloon, other)
        return boxes_meet(wp.min(point, end), wp.max(point, end), lower, upper, pad)

    return is_nearing


@wp.func
def exceeds_search_margin(working: Working, world: wp.int32, balloon: wp.int32):
    """Test for a balloon whose particles may have moved farther than its lists allow."""
    return working.balloon_boxes[world, balloon, PACE][STRAYED] > 0.0


@wp.func
def decide(working: Working, world: wp.int32, near: bool, strayed: bool):
    """Choose the balloons of a world that search, and clear their lists.

    Args:
        near: Whether any of its balloons are near each other.
        strayed: Whether any balloon has strayed.
    """
    now = wp.where(is_known(working, world), WAS_NEAR, APART)
    if near:
        now = wp.where(strayed, ARE_NEAR, STILL_NEAR)
    if now != STILL_NEAR:
        for which in range(working.list_lengths.shape[1]):
            working.list_lengths[world, which] = 0
    working.near_balloons[world, working.balloon_boxes.shape[1]] = now


@cache
def meet_kernel(features: Features) -> Any:
    """Return the kernel that finds the balloons that may touch, and the work that this asks for."""
    pad_between = pad_function(features)

    @wp.func
    def meet(t: Tables, working: Working, world: wp.int32, balloon: wp.int32):
        """Record the balloons that one may touch, and return the work of its particles."""
        count = wp.int32(0)
        strayed = exceeds_search_margin(working, world, balloon)
        lower = working.balloon_boxes[world, balloon, LOWER]
        upper = working.balloon_boxes[world, balloon, UPPER]
        for other in range(working.balloon_boxes.shape[1]):
            near = bool(wp.static(features.touches_itself))
            if other != balloon:
                other_lower = working.balloon_boxes[world, other, LOWER]
                other_upper = working.balloon_boxes[world, other, UPPER]
                near = boxes_meet(lower, upper, other_lower, other_upper, pad_between(t, world, balloon, other))
            if near:
                working.neighbors[world, balloon, count] = other
                count += 1
                strayed = strayed or exceeds_search_margin(working, world, other)
        working.neighbor_counts[world, balloon] = count
        return wp.where(count > 0, wp.where(strayed, SEARCHES, KNOWN), ALONE)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def meet_balloons(
        # model
        t: Tables,
        # in and out
        working: Working,
    ):
        """Find the balloons that may touch; a block a world."""
        world, thread = wp.tid()
        near = bool(False)
        strayed = bool(False)
        for balloon in range(thread, working.balloon_boxes.shape[1], wp.block_dim()):
            does = meet(t, working, world, balloon)
            working.near_balloons[world, balloon] = does
            near = near or does != ALONE
            strayed = strayed or exceeds_search_margin(working, world, balloon)
        any_near = any_in_block(near)
        any_strayed = any_in_block(strayed)
        if thread == 0:
            decide(working, world, any_near, any_strayed)

    return meet_balloons


@wp.func
def is_searched(working: Working, world: wp.int32):
    """Return whether there are lists to make, or to clear."""
    what = working.near_balloons[world, working.balloon_boxes.shape[1]]
    return what > APART and what < STILL_NEAR


@wp.struct
class Swept:
    """Box around the sweep of an edge or a leaf until the next search [m]."""

    lower: wp.vec3
    upper: wp.vec3


@wp.func
def box_at(boxes: wp.array2d[wp.vec4], world: wp.int32, number: wp.int32):
    """Return a stored box."""
    lower = four_in(boxes, world, 2 * number)
    upper = four_in(boxes, world, 2 * number + 1)
    swept = Swept()
    swept.lower = wp.vec3(lower[0], lower[1], lower[2])
    swept.upper = wp.vec3(upper[0], upper[1], upper[2])
    return swept


@wp.func
def put_box(boxes: wp.array2d[wp.vec4], world: wp.int32, number: wp.int32, swept: Swept):
    """Store a box: many others will be compared with it."""
    lower, upper = swept.lower, swept.upper
    put_four_in(boxes, world, 2 * number, wp.vec4(lower[0], lower[1], lower[2], 0.0))
    put_four_in(boxes, world, 2 * number + 1, wp.vec4(upper[0], upper[1], upper[2], 0.0))


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
def swept_by_leaf(
    t: Tables, working: Working, world: wp.int32, leaf: wp.int32, points: wp.array[wp.vec3],
    velocities: wp.array[wp.vec3],
):  # fmt: skip
    """Return the box around the sweep of a leaf, if its balloon may touch any; else one that nothing meets."""
    swept = Swept()
    swept.lower = wp.vec3(FAR_AWAY)
    swept.upper = wp.vec3(-FAR_AWAY)
    own = int_pair_at(t.touch.leaf_particles, leaf)
    for place in range(own[0], own[1]):
        particle = int_at(t.touch.particles, place)
        if working.near_balloons[world, int_at(t.particles.balloon, particle)] != ALONE:
            here = vector_at(points, particle)
            there = here + t.touch.seconds * vector_at(velocities, particle)
            swept.lower = wp.min(swept.lower, wp.min(here, there))
            swept.upper = wp.max(swept.upper, wp.max(here, there))
    return swept


@wp.func
def warp_box(swept: Swept, counts: bool):
    """Return the box around those of the threads of a warp that count; called by all of them."""
    around = Swept()
    for axis in range(3):
        around.lower[axis] = -warp_max(wp.where(counts, -swept.lower[axis], -FAR_AWAY))
        around.upper[axis] = warp_max(wp.where(counts, swept.upper[axis], -FAR_AWAY))
    return around


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    return 32;
#else
    return 8;
#endif
    """
)
def row_size() -> wp.int32:
    """Return the number of leaves of a row: those that a thread compares at once, or the threads of a warp."""
    ...


@wp.kernel(enable_backward=False)
def box_leaves(
    # model
    t: Tables,
    threads: wp.int32,
    # state in
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    # out
    working: Working,
):
    """Box leaves, and rows of them, by some threads a world."""
    world, thread = wp.tid()
    if working.near_balloons[world, working.balloon_boxes.shape[1]] == ARE_NEAR:
        leaf = wp.int32(thread)
        while any_in_warp(leaf < t.touch.leaves.shape[0]):
            swept = Swept()
            is_there = leaf < t.touch.leaves.shape[0]
            if is_there:
                swept = swept_by_leaf(t, working, world, leaf, points[world], velocities[world])
                put_box(working.leaf_boxes, world, leaf, swept)
            row = leaf / row_size()
            around = warp_box(swept, is_there)
            if thread_of_warp() == 0 and 2 * row < working.row_boxes.shape[1]:
                put_box(working.row_boxes, world, row, around)
            leaf += threads


def row_count(leaves: int, balloons: int) -> int:
    """Return the rows of a world: of triangles, of leaves, of such rows, and two for each eight neighbors."""
    rows = -(-leaves // 8)
    return leaves + rows + -(-rows // 8) + 2 * -(-balloons // 8)


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    typedef bool bits __attribute__((ext_vector_type(8)));
    const eight* box = reinterpret_cast<const eight*>(&boxes.data[(unsigned int)row]);
    eight ways[3];
    for (int axis = 0; axis < 3; ++axis) {
        const eight below = box[axis] - point[axis];
        const eight above = point[axis] - box[3 + axis];
        const eight way = below > above ? below : above;
        ways[axis] = way > 0.0f ? way : way - way;
    }
    const eight distance = ways[0] * ways[0] + ways[1] * ways[1] + ways[2] * ways[2];
    const bits near = __builtin_convertvector(distance <= squared, bits);
    unsigned char mask;
    __builtin_memcpy(&mask, &near, 1);
    return mask;
    """
)
def which_are_near(boxes: wp.array[EightBoxes], row: wp.int32, point: wp.vec3, squared: float) -> wp.int32:
    """Return a bit for each box of a row that is within a squared distance of a point [m^2].

    It rounds as `boxes.squared_distance_to_box`.
    """
    ...


@wp.func_native(
    """
    auto& box = boxes.data[(unsigned int)row].data;
    for (int lane = 0; lane < 8; ++lane)
        for (int axis = 0; axis < 3; ++axis) {
            box[axis][lane] = 1.0e30f;
            box[3 + axis][lane] = -1.0e30f;
        }
    """
)
def clear_boxes(boxes: wp.array[EightBoxes], row: wp.int32):
    """Leave a row with no boxes."""
    ...


@wp.func_native("boxes.data[(unsigned int)row].data[0][0] = NAN;")
def forget_boxes(boxes: wp.array[EightBoxes], row: wp.int32):
    """Mark a row as one that is to be filled when it is looked at."""
    ...


@wp.func_native(
    """
    auto& box = boxes.data[(unsigned int)row].data;
    for (int axis = 0; axis < 3; ++axis) {
        box[axis][lane] = lower[axis] < box[axis][lane] ? lower[axis] : box[axis][lane];
        box[3 + axis][lane] = upper[axis] > box[3 + axis][lane] ? upper[axis] : box[3 + axis][lane];
    }
    """
)
def stretch_box(boxes: wp.array[EightBoxes], row: wp.int32, lane: wp.int32, lower: wp.vec3, upper: wp.vec3):
    """Stretch a box so that it contains another."""
    ...


@wp.func_native(
    """
    auto& box = boxes.data[(unsigned int)row].data;
    if (box[0][0] == box[0][0])
        return;
    #pragma clang loop unroll(disable)
    for (int lane = 0; lane < 8; ++lane)
        for (int axis = 0; axis < 3; ++axis) {
            float lower = 1.0e30f, upper = -1.0e30f;
            if (begin + lane < end)
                for (int corner = 0; corner < 3; ++corner) {
                    const float here = points.data[(unsigned int)triangles.data[begin + lane][corner]][axis];
                    lower = here < lower ? here : lower;
                    upper = here > upper ? here : upper;
                }
            box[axis][lane] = lower;
            box[3 + axis][lane] = upper;
        }
    """
)
def box_triangles(
    boxes: wp.array[EightBoxes], row: wp.int32, begin: wp.int32, end: wp.int32, triangles: wp.array[wp.vec3i],
    points: wp.array[wp.vec3],
):  # fmt: skip
    """Fill the row of a leaf with the boxes of its triangles, unless it is filled."""
    ...


@wp.func
def first_leaf(t: Tables, balloon: wp.int32):
    """Return the first leaf of a balloon."""
    return int_at(t.touch.balloon_leaves, balloon)


@wp.func
def rows_of_leaves(t: Tables):
    """Return the first row of boxes of leaves: after those of the triangles of each leaf."""
    return t.touch.leaves.shape[0]


@wp.func
def rows_of_such_rows(t: Tables):
    """Return the first row of boxes of such rows."""
    return rows_of_leaves(t) + ((t.touch.leaves.shape[0] + 7) >> 3)


@wp.func_native(
    """
    auto& box = boxes.data[(unsigned int)row].data;
    for (int axis = 0; axis < 3; ++axis) {
        box[axis][lane] = lower[axis];
        box[3 + axis][lane] = upper[axis];
    }
    boxes.data[(unsigned int)row + 1].data[0][lane] = pad;
    """
)
def put_padded_box(
    boxes: wp.array[EightBoxes], row: wp.int32, lane: wp.int32, lower: wp.vec3, upper: wp.vec3, pad: float
):  # fmt: skip
    """Store a box, and in the next row the distance at which others are near it [m]."""
    ...


WHICH_MEET = """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    typedef bool bits __attribute__((ext_vector_type(8)));
    const eight* box = reinterpret_cast<const eight*>(&boxes.data[(unsigned int)row]);
    eight gaps[3];
    for (int axis = 0; axis < 3; ++axis) {
        const eight below = lower[axis] - box[3 + axis];
        const eight above = box[axis] - upper[axis];
        gaps[axis] = below > above ? below : above;
    }
    const eight two = gaps[0] > gaps[1] ? gaps[0] : gaps[1];
    const bits near = __builtin_convertvector((two > gaps[2] ? two : gaps[2]) <= PAD, bits);
    unsigned char mask;
    __builtin_memcpy(&mask, &near, 1);
    return mask;
"""


@wp.func_native(WHICH_MEET.replace("PAD", "box[6]"))
def which_meet(boxes: wp.array[EightBoxes], row: wp.int32, lower: wp.vec3, upper: wp.vec3) -> wp.int32:
    """Return a bit for each padded box of a row that another meets, see `boxes.boxes_meet`."""
    ...


@wp.func_native(WHICH_MEET.replace("PAD", "pad"))
def which_are_within(
    boxes: wp.array[EightBoxes], row: wp.int32, lower: wp.vec3, upper: wp.vec3, pad: float
) -> wp.int32:
    """Return a bit for each box of a row that is within a distance of another, see `boxes.boxes_meet`."""
    ...


@wp.func
def first_rows(t: Tables, balloon: wp.int32):
    """Return the first row of those compared at once with the first leaf of a balloon."""
    return first_leaf(t, balloon) / (row_size() * row_size()) * row_size()


@wp.func
def end_of_rows(t: Tables, balloon: wp.int32):
    """Return the end of the rows of leaves with those of a balloon."""
    return (first_leaf(t, balloon + 1) + row_size() - 1) / row_size()


@wp.func
def votes_on_rows(t: Tables, working: Working, world: wp.int32, rows: wp.int32, around: Swept, pad: float):
    """Return a bit for each of some rows of leaves whose box is near another; called by all threads of a warp."""
    near = bool(False)
    row = rows + thread_of_warp()
    if 2 * row < working.row_boxes.shape[1]:
        here = box_at(working.row_boxes, world, row)
        near = boxes_meet(around.lower, around.upper, here.lower, here.upper, pad)
    return votes_of_warp(near)


@wp.func
def votes_on_leaves(
    t: Tables, working: Working, world: wp.int32, balloon: wp.int32, row: wp.int32, around: Swept, pad: float
):  # fmt: skip
    """Return a bit for each leaf of a balloon in a row whose box is near another; called by all threads of a warp."""
    near = bool(False)
    leaf = row_size() * row + thread_of_warp()
    if leaf >= first_leaf(t, balloon) and leaf < first_leaf(t, balloon + 1):
        here = box_at(working.leaf_boxes, world, leaf)
        near = boxes_meet(around.lower, around.upper, here.lower, here.upper, pad)
    return votes_of_warp(near)


@wp.func
def which_rows_meet(t: Tables, working: Working, world: wp.int32, rows: wp.int32, around: Swept, pad: float):
    """Return the same bits by eight boxes at a time."""
    row = rows_of_such_rows(t) + (rows >> 3)
    return which_are_within(working.eight_boxes[world], row, around.lower, around.upper, pad)


@wp.func
def which_leaves_meet(
    t: Tables, working: Working, world: wp.int32, balloon: wp.int32, row: wp.int32, around: Swept, pad: float
):  # fmt: skip
    """Return the same bits by eight boxes at a time."""
    near = which_are_within(working.eight_boxes[world], rows_of_leaves(t) + row, around.lower, around.upper, pad)
    return those_of_balloon(t, balloon, row, near)


@wp.func
def those_of_balloon(t: Tables, balloon: wp.int32, row: wp.int32, leaves: wp.int32):
    """Return the bits of those leaves of a row of eight that are a balloon's."""
    first = wp.max(first_leaf(t, balloon) - 8 * row, 0)
    end = wp.clamp(first_leaf(t, balloon + 1) - 8 * row, 0, 8)
    return wp.where(first < 8, (leaves & ((1 << end) - 1)) >> first << first, 0)


@wp.func
def which_rows_are_near(
    t: Tables, working: Working, world: wp.int32, rows: wp.int32, point: wp.vec3, squared: float, asks: bool
):  # fmt: skip
    """Return a bit for each of eight rows of leaves whose box is within a squared distance of a point [m^2]."""
    return which_are_near(working.eight_boxes[world], rows_of_such_rows(t) + (rows >> 3), point, squared)


@wp.func
def which_leaves_are_near(
    t: Tables, working: Working, world: wp.int32, balloon: wp.int32, row: wp.int32, point: wp.vec3, squared: float,
    asks: bool,
):  # fmt: skip
    """Return a bit for each leaf of a balloon in a row of eight that is so near."""
    near = which_are_near(working.eight_boxes[world], rows_of_leaves(t) + row, point, squared)
    return those_of_balloon(t, balloon, row, near)


ROUNDING = wp.constant(1.0e-6)
"""Part of a coordinate by which a box is larger than rounding may make it smaller"""


@wp.func
def box_around(point: wp.vec3, squared: float, counts: bool):
    """Return the box around the spheres about those points of a warp that count, of a squared radius [m^2]."""
    distance = wp.sqrt(squared)
    size = wp.max(wp.abs(point)) + distance
    within = distance + ROUNDING * size
    here = Swept()
    here.lower = point - wp.vec3(within)
    here.upper = point + wp.vec3(within)
    return warp_box(here, counts)


@wp.func
def votes_on_near_rows(
    t: Tables, working: Working, world: wp.int32, rows: wp.int32, point: wp.vec3, squared: float, asks: bool
):  # fmt: skip
    """Return a bit for each of some rows of leaves that may be within a squared distance [m^2] of a point that asks.

    All threads of a warp call it, with their points.
    """
    return votes_on_rows(t, working, world, rows, box_around(point, squared, asks), 0.0)


@wp.func
def votes_on_near_leaves(
    t: Tables, working: Working, world: wp.int32, balloon: wp.int32, row: wp.int32, point: wp.vec3, squared: float,
    asks: bool,
):  # fmt: skip
    """Return a bit for each leaf of a balloon in a row that may be so near."""
    return votes_on_leaves(t, working, world, balloon, row, box_around(point, squared, asks), 0.0)


@wp.func
def neighbor_rows(working: Working, boxes: wp.array[EightBoxes]):
    """Return the first row of a balloon's neighbors."""
    return boxes.shape[0] - 2 * ((working.balloon_boxes.shape[1] + 7) >> 3)


@cache
def lining_function(features: Features) -> Any:
    """Packer of the boxes of a balloon's neighbors into SIMD rows."""
    pad_between = pad_function(features)

    @wp.func
    def line_up_neighbors(t: Tables, working: Working, world: wp.int32, particle: wp.int32, before: wp.int32):
        """Store the neighbors of a particle's balloon, eight a row, unless the one before is of the same: -1 if none.

        They keep their order.
        """
        balloon = int_at(t.particles.balloon, particle)
        if before < 0 or int_at(t.particles.balloon, before) != balloon:
            boxes = working.eight_boxes[world]
            first = neighbor_rows(working, boxes)
            for place in range(working.neighbor_counts[world, balloon]):
                row = first + 2 * (place >> 3)
                if place % 8 == 0:
                    clear_boxes(boxes, row)
                    boxes[row + 1] = EightBoxes()
                other = working.neighbors[world, balloon, place]
                lower = working.balloon_boxes[world, other, LOWER]
                upper = working.balloon_boxes[world, other, UPPER]
                put_padded_box(boxes, row, place & 7, lower, upper, pad_between(t, world, balloon, other))

    return line_up_neighbors


@wp.func
def nearing_ones(
    t: Tables, working: Working, world: wp.int32, place: wp.int32, point: wp.vec3, velocity: wp.vec3
):  # fmt: skip
    """Return a bit for each of eight neighbors, from a place on, that a particle may touch: see `boxes.is_nearing`."""
    boxes = working.eight_boxes[world]
    end = point + t.touch.seconds * velocity
    row = neighbor_rows(working, boxes) + 2 * (place >> 3)
    return which_meet(boxes, row, wp.min(point, end), wp.max(point, end))


@wp.kernel(enable_backward=False)
def line_up_boxes(
    # model
    t: Tables,
    # in and out
    working: Working,
):
    """Put the boxes of leaves side by side, in the order of the tree; a thread a world."""
    world = wp.tid()
    if working.near_balloons[world, working.balloon_boxes.shape[1]] == ARE_NEAR:
        boxes = working.eight_boxes[world]
        rows = rows_of_leaves(t)
        for row in range(rows, boxes.shape[0]):
            clear_boxes(boxes, row)
        for leaf in range(t.touch.leaves.shape[0]):
            here = box_at(working.leaf_boxes, world, leaf)
            forget_boxes(boxes, leaf)
            stretch_box(boxes, rows + (leaf >> 3), leaf & 7, here.lower, here.upper)
            stretch_box(boxes, rows_of_such_rows(t) + (leaf >> 6), (leaf >> 3) & 7, here.lower, here.upper)

"""Bounding boxes of balloons and of their parts, swept until the next search.

SIMD boxes: eight box tests at once in a CPU's vector registers. A row
is of the triangles of a leaf, or of eight leaves that follow each other, or of eight such rows. Leaves have the order
of the tree of parts, so that a search meets the same ones as in the tree, in the same order. The boxes of triangles are
made when a search first looks into their leaf.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.contact import skin_functions
from balloon_warp.kernels.memory import four_in, four_ints_at, int_at, int_pair_at, put_four_in, vector_at
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.warps import any_in_block, block_barrier
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


def row_count(parts: int, leaves: int, balloons: int) -> int:
    """Return the rows of a world: of triangles, of leaves, of such rows, and two for each eight neighbors."""
    rows = -(-leaves // 8)
    return parts + rows + -(-rows // 8) + 2 * -(-balloons // 8)


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


@wp.func_native("return __builtin_ctz(bits);")
def first_of(bits: wp.int32) -> wp.int32:
    """Return the number of the lowest bit that is set."""
    ...


@wp.func
def without_first(bits: wp.int32):
    """Return bits without the lowest that is set."""
    return bits & (bits - 1)


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
def stretch_box(boxes: wp.array[EightBoxes], row: wp.int32, lane: wp.int32, lower: wp.vec4, upper: wp.vec4):
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
def is_filled(node: wp.vec4i):
    """Return whether a part has triangles: a balloon without faces has one without."""
    return node[2] > node[1]


@wp.func
def first_leaf(t: Tables, balloon: wp.int32):
    """Return the number of leaves before those of a balloon: every part has two halves, or is a leaf."""
    return (int_at(t.touch.balloon_parts, balloon) + balloon) >> 1


@wp.func
def begin_of_leaves(t: Tables, balloon: wp.int32, count: wp.int32):
    """Return where a search among the leaves of a balloon begins, see `contact.triangles.begin_of_parts`."""
    return wp.where(count >= 0, 0, first_leaf(t, balloon))


@wp.func
def end_of_leaves(t: Tables, balloon: wp.int32, count: wp.int32):
    """Return where a search among the leaves of a balloon ends."""
    return wp.where(count >= 0, count, first_leaf(t, balloon + 1))


@wp.func
def leaf_of_search(
    t: Tables, working: Working, world: wp.int32, home: wp.int32, at: wp.int32, count: wp.int32
):  # fmt: skip
    """Return the part at a place of a search among leaves, see `contact.triangles.part_of_search`."""
    if count >= 0:
        return working.near_parts[world, home, at]
    return int_at(t.touch.parts_by_level, at)


@wp.func
def next_near(
    t: Tables, boxes: wp.array[EightBoxes], leaf: wp.int32, last: wp.int32, point: wp.vec3, squared: float
):  # fmt: skip
    """Return the first leaf from one on whose box is within a squared distance of a point [m^2], or the last."""
    rows = t.touch.parts.shape[0]
    rows_of_rows = rows + ((int_at(t.touch.levels, 1) + 7) >> 3)
    at = leaf
    while at < last:
        near = which_are_near(boxes, rows + (at >> 3), point, squared) >> (at & 7)
        if near != 0:
            return wp.min(at + first_of(near), last)
        row = (at >> 3) + 1
        at = last
        while 8 * row < last:
            near = which_are_near(boxes, rows_of_rows + (row >> 3), point, squared) >> (row & 7)
            if near != 0:
                at = 8 * (row + first_of(near))
                row = last
            else:
                row = ((row >> 3) + 1) << 3
    return last


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


@wp.func_native(
    """
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
    const bits near = __builtin_convertvector((two > gaps[2] ? two : gaps[2]) <= box[6], bits);
    unsigned char mask;
    __builtin_memcpy(&mask, &near, 1);
    return mask;
    """
)
def which_meet(boxes: wp.array[EightBoxes], row: wp.int32, lower: wp.vec3, upper: wp.vec3) -> wp.int32:
    """Return a bit for each padded box of a row that another meets, see `boxes.boxes_meet`."""
    ...


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
        rows = t.touch.parts.shape[0]
        rows_of_rows = rows + ((int_at(t.touch.levels, 1) + 7) >> 3)
        for row in range(rows, boxes.shape[0]):
            clear_boxes(boxes, row)
        for leaf in range(int_at(t.touch.levels, 1)):
            part = int_at(t.touch.parts_by_level, leaf)
            if is_boxed(working, world, four_ints_at(t.touch.parts, part)):
                lower = lower_of_part(working, world, part)
                upper = upper_of_part(working, world, part)
                forget_boxes(boxes, part)
                stretch_box(boxes, rows + (leaf >> 3), leaf & 7, lower, upper)
                stretch_box(boxes, rows_of_rows + (leaf >> 6), (leaf >> 3) & 7, lower, upper)

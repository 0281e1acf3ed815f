"""Boxes eight side by side: a CPU's vector registers hold eight numbers, so that one comparison is for eight boxes.

A row is of the triangles of a leaf, or of eight leaves that follow each other, or of eight such rows. Leaves have the
order of the tree of parts, see `contact.parts`, so that a search meets the same ones as in the tree, in the same order.
The boxes of triangles are made when a search first looks into their leaf.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.boxes import ARE_NEAR, LOWER, UPPER, pad_function
from balloon_warp.kernels.contact.parts import is_boxed, lower_of_part, upper_of_part
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.memory import four_ints_at, int_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import EightBoxes, Working

wp.set_module_options(OPTIONS)


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


@wp.func_native('boxes.data[(unsigned int)row].data[0][0] = __builtin_nanf("");')
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
    """Return where a search among the leaves of a balloon begins, see `near_parts.begin_of_parts`."""
    return wp.where(count >= 0, 0, first_leaf(t, balloon))


@wp.func
def end_of_leaves(t: Tables, balloon: wp.int32, count: wp.int32):
    """Return where a search among the leaves of a balloon ends."""
    return wp.where(count >= 0, count, first_leaf(t, balloon + 1))


@wp.func
def leaf_of_search(
    t: Tables, working: Working, world: wp.int32, home: wp.int32, at: wp.int32, count: wp.int32
):  # fmt: skip
    """Return the part at a place of a search among leaves, see `near_parts.part_of_search`."""
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
    """Return the function that puts the boxes of a balloon's neighbors side by side."""
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

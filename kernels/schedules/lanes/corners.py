"""Sums at the corners of quads, in the same order for eight worlds and for eight quads of one.

Eight worlds go quad by quad, and add to its four corners. Quads of one world may share corners: lane by lane, each adds
to its four, so that a particle's sum adds up alike.
"""

import warp as wp

from balloon_warp.kernels.lanes import LaneNumbers, Lanes3
from balloon_warp.kernels.schedules.lanes.layouts import add


@wp.func
def add_to_corners(
    vectors: wp.array[Lanes3], first: wp.int32, second: wp.int32, third: wp.int32, fourth: wp.int32,
    on_first: Lanes3, on_second: Lanes3, on_third: Lanes3, on_fourth: Lanes3,
):  # fmt: skip
    """Add vectors to those of a quad's corners, of eight worlds."""
    add(vectors, first, on_first)
    add(vectors, second, on_second)
    add(vectors, third, on_third)
    add(vectors, fourth, on_fourth)


@wp.func_native(
    """
    typedef float four __attribute__((ext_vector_type(4)));
    typedef float eight __attribute__((ext_vector_type(8)));
    four of_lane[4][8];
    const auto turn = [&of_lane](int corner, const wp::mat_t<3, 8, float>& more) {
        eight x, y, z, none = 0.0f;
        __builtin_memcpy(&x, more.data[0], sizeof(eight));
        __builtin_memcpy(&y, more.data[1], sizeof(eight));
        __builtin_memcpy(&z, more.data[2], sizeof(eight));
        const eight xy[2] = {
            __builtin_shufflevector(x, y, 0, 8, 1, 9, 2, 10, 3, 11),
            __builtin_shufflevector(x, y, 4, 12, 5, 13, 6, 14, 7, 15)};
        const eight zw[2] = {
            __builtin_shufflevector(z, none, 0, 8, 1, 9, 2, 10, 3, 11),
            __builtin_shufflevector(z, none, 4, 12, 5, 13, 6, 14, 7, 15)};
        for (int half = 0; half < 2; ++half) {
            of_lane[corner][4 * half] = __builtin_shufflevector(xy[half], zw[half], 0, 1, 8, 9);
            of_lane[corner][4 * half + 1] = __builtin_shufflevector(xy[half], zw[half], 2, 3, 10, 11);
            of_lane[corner][4 * half + 2] = __builtin_shufflevector(xy[half], zw[half], 4, 5, 12, 13);
            of_lane[corner][4 * half + 3] = __builtin_shufflevector(xy[half], zw[half], 6, 7, 14, 15);
        }
    };
    turn(0, on_first);
    turn(1, on_second);
    turn(2, on_third);
    turn(3, on_fourth);
    for (int lane = 0; lane < 8; ++lane) {
        const int corners[4] = {first[lane], second[lane], third[lane], fourth[lane]};
        for (int corner = 0; corner < 4; ++corner) {
            four vector;
            __builtin_memcpy(&vector, &vectors.data[corners[corner]], sizeof(four));
            vector += of_lane[corner][lane];
            __builtin_memcpy(&vectors.data[corners[corner]], &vector, sizeof(four));
        }
    }
    """
)
def add_to_corners(  # noqa: F811 - an overload
    vectors: wp.array[wp.vec4], first: LaneNumbers, second: LaneNumbers, third: LaneNumbers, fourth: LaneNumbers,
    on_first: Lanes3, on_second: Lanes3, on_third: Lanes3, on_fourth: Lanes3,
):  # fmt: skip
    """Add vectors to those of the corners of eight quads, lane by lane, in vector registers of a particle each."""
    ...

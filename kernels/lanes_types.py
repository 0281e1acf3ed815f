"""Eight worlds side by side, so that one instruction of the CPU serves all eight.

Loops over the lanes have constant bounds: Warp unrolls them and the compiler turns them into vector instructions, also
where the body calls a law for one world.
"""

import warp as wp

from balloon_warp.kernels.springs import squared_length

LANE_COUNT = wp.constant(8)
Lanes = wp.types.vector(length=8, dtype=wp.float32)
"""a number in each of eight worlds"""
Lanes3 = wp.types.matrix(shape=(3, 8), dtype=wp.float32)
"""a vector in each of eight worlds, one a column"""


@wp.func
def column(lanes: Lanes3, lane: wp.int32):
    """The vector of one world."""
    return wp.vec3(lanes[0, lane], lanes[1, lane], lanes[2, lane])


@wp.func
def set_column(lanes: Lanes3, lane: wp.int32, vector: wp.vec3):
    """The vectors with that of one world replaced."""
    lanes[0, lane] = vector[0]
    lanes[1, lane] = vector[1]
    lanes[2, lane] = vector[2]
    return lanes


@wp.func
def cross_product(a: wp.vec3, b: wp.vec3):
    """a x b"""
    return wp.cross(a, b)


@wp.func
def cross_product(a: Lanes3, b: Lanes3):  # noqa: F811 - an overload
    """a x b in each world."""
    product = Lanes3()
    for lane in range(LANE_COUNT):
        product[0, lane] = a[1, lane] * b[2, lane] - a[2, lane] * b[1, lane]
        product[1, lane] = a[2, lane] * b[0, lane] - a[0, lane] * b[2, lane]
        product[2, lane] = a[0, lane] * b[1, lane] - a[1, lane] * b[0, lane]
    return product


@wp.func
def squared_lengths(lanes: Lanes3):
    """The squared length in each world, and a little more, so that its root can be divided by."""
    squared = Lanes()
    for lane in range(LANE_COUNT):
        squared[lane] = squared_length(column(lanes, lane))
    return squared


@wp.func
def lanes_scaled(lanes: Lanes3, factors: Lanes):
    """Each world's vector times its own factor."""
    for lane in range(LANE_COUNT):
        lanes[0, lane] *= factors[lane]
        lanes[1, lane] *= factors[lane]
        lanes[2, lane] *= factors[lane]
    return lanes

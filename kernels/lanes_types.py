"""Eight worlds side by side, so that one instruction of the CPU serves all eight.

Loops over the lanes have constant bounds: Warp unrolls them and the compiler turns them into vector instructions, also
where the body calls a law for one world. It is less sure of that where components mix: what it makes of 24 numbers in a
row is then mostly shuffles. That algebra is native, a row of eight at a time.
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


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight* p = reinterpret_cast<const eight*>(&a.data[0][0]);
    const eight* q = reinterpret_cast<const eight*>(&b.data[0][0]);
    wp::mat_t<3, 8, wp::float32> result;
    eight* r = reinterpret_cast<eight*>(&result.data[0][0]);
    r[0] = p[1] * q[2] - p[2] * q[1];
    r[1] = p[2] * q[0] - p[0] * q[2];
    r[2] = p[0] * q[1] - p[1] * q[0];
    return result;
    """
)
def cross_product(a: Lanes3, b: Lanes3) -> Lanes3:  # noqa: F811 - an overload
    """a x b in each world."""
    ...


@wp.func
def squared_lengths(lanes: Lanes3):
    """The squared length in each world, and a little more, so that its root can be divided by."""
    squared = Lanes()
    for lane in range(LANE_COUNT):
        squared[lane] = squared_length(column(lanes, lane))
    return squared


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight* p = reinterpret_cast<const eight*>(&a.data[0][0]);
    const eight* q = reinterpret_cast<const eight*>(&b.data[0][0]);
    wp::vec_t<8, wp::float32> result;
    *reinterpret_cast<eight*>(&result.c[0]) = p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    return result;
    """
)
def dot_products(a: Lanes3, b: Lanes3) -> Lanes:
    """a . b in each world."""
    ...


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight* p = reinterpret_cast<const eight*>(&lanes.data[0][0]);
    wp::vec_t<8, wp::float32> result;
    *reinterpret_cast<eight*>(&result.c[0]) = direction.c[0] * p[0] + direction.c[1] * p[1] + direction.c[2] * p[2];
    return result;
    """
)
def parts_along(lanes: Lanes3, direction: wp.vec3) -> Lanes:
    """How far each world's vector reaches along one direction."""
    ...


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    return __builtin_reduce_or(*reinterpret_cast<const eight*>(&lanes.c[0]) < 0.0f) != 0;
    """
)
def any_negative(lanes: Lanes) -> bool:
    """Whether a number is below zero in any of the worlds."""
    ...


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight f = *reinterpret_cast<const eight*>(&factors.c[0]);
    const eight* p = reinterpret_cast<const eight*>(&lanes.data[0][0]);
    wp::mat_t<3, 8, wp::float32> result;
    eight* r = reinterpret_cast<eight*>(&result.data[0][0]);
    r[0] = f * p[0];
    r[1] = f * p[1];
    r[2] = f * p[2];
    return result;
    """
)
def lanes_scaled(lanes: Lanes3, factors: Lanes) -> Lanes3:
    """Each world's vector times its own factor."""
    ...

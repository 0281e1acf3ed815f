"""Vectors and numbers, of one particle or of eight side by side: the same names for both.

Eight side by side, one instruction of a CPU serves all of them: each has a *lane*. A lane is a world or a particle, see
`kernels.schedules.lanes`. Loops over the lanes have constant bounds: Warp unrolls them, and the compiler makes vector
instructions of them, also where the body calls a law for one particle. It is less sure of that where components mix;
that algebra is native, a row of eight at a time.
"""

from typing import Any

import warp as wp

LANE_COUNT = wp.constant(8)
Lanes = wp.types.vector(length=8, dtype=wp.float32)
"""a number in each of eight lanes"""
Lanes2 = wp.types.matrix(shape=(2, 8), dtype=wp.float32)
"""two numbers in each of eight lanes, those of one a column"""
Lanes3 = wp.types.matrix(shape=(3, 8), dtype=wp.float32)
"""a vector in each of eight lanes, one a column"""
Lanes4 = wp.types.matrix(shape=(4, 8), dtype=wp.float32)
"""four numbers in each of eight lanes, those of one a column"""
Lanes5 = wp.types.matrix(shape=(5, 8), dtype=wp.float32)
"""five numbers in each of eight lanes, those of one a column"""
Five = wp.types.vector(length=5, dtype=wp.float32)
"""five numbers"""
IN_LANES = {
    float: Lanes, wp.float32: Lanes, wp.vec2: Lanes2, wp.vec3: Lanes3, wp.vec4: Lanes4, Five: Lanes5,
}  # fmt: skip
"""what stands in eight lanes, by what stands in one"""
LaneNumbers = wp.types.vector(length=8, dtype=wp.int32)
"""the number of a particle, or of something else, in each of eight lanes"""

NOT_QUITE_ZERO = wp.constant(1.0e-20)
"""[m^2], added to a squared length, so that its root can be divided by"""


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    return rsqrtf(x);
#else
    return 1.0f / sqrtf(x);
#endif
    """,
    adj_snippet="adj_x -= 0.5f * adj_ret / (x * sqrtf(x));",
)
def inverse_root(x: float) -> float:
    """1 / sqrt(x); one instruction of a GPU, where the division of a root takes two even with fast math."""
    ...


# ---- one of eight


@wp.func
def of_lane(number: float, lane: wp.int32):
    """What is the same in all lanes."""
    return number


@wp.func
def of_lane(number: wp.int32, lane: wp.int32):  # noqa: F811 - an overload
    """What is the same in all lanes."""
    return number


@wp.func
def of_lane(vector: wp.vec3, lane: wp.int32):  # noqa: F811 - an overload
    """What is the same in all lanes."""
    return vector


@wp.func
def of_lane(numbers: Lanes, lane: wp.int32):  # noqa: F811 - an overload
    """The number of one lane."""
    return numbers[lane]


@wp.func
def of_lane(vectors: Lanes3, lane: wp.int32):  # noqa: F811 - an overload
    """The vector of one lane."""
    return wp.vec3(vectors[0, lane], vectors[1, lane], vectors[2, lane])


@wp.func
def of_lane(vectors: wp.vec4, lane: wp.int32):  # noqa: F811 - an overload
    """What is the same in all lanes."""
    return vectors


@wp.func
def of_lane(vectors: Lanes4, lane: wp.int32):  # noqa: F811 - an overload
    """The four numbers of one lane."""
    return wp.vec4(vectors[0, lane], vectors[1, lane], vectors[2, lane], vectors[3, lane])


@wp.func
def of_lane(numbers: LaneNumbers, lane: wp.int32):  # noqa: F811 - an overload
    """The number of one lane."""
    return numbers[lane]


@wp.func
def of_lane(pairs: Lanes2, lane: wp.int32):  # noqa: F811 - an overload
    """The two numbers of one lane."""
    return wp.vec2(pairs[0, lane], pairs[1, lane])


@wp.func
def of_lane(fives: Lanes5, lane: wp.int32):  # noqa: F811 - an overload
    """The five numbers of one lane."""
    return Five(fives[0, lane], fives[1, lane], fives[2, lane], fives[3, lane], fives[4, lane])


@wp.func
def number_in(row: Any, column: wp.int32, lane: wp.int32):
    """A number of a row of one particle's."""
    return row[column]


@wp.func
def number_in(row: wp.array[Lanes], column: wp.int32, lane: wp.int32):  # noqa: F811 - an overload
    """The number of one lane, of a row of lanes."""
    return row[column][lane]


@wp.func
def set_lane(vectors: Lanes3, lane: wp.int32, vector: wp.vec3):
    """The vectors with that of one lane replaced."""
    vectors[0, lane] = vector[0]
    vectors[1, lane] = vector[1]
    vectors[2, lane] = vector[2]
    return vectors


@wp.func
def set_lane(numbers: Lanes, lane: wp.int32, number: float):  # noqa: F811 - an overload
    """The numbers with that of one lane replaced."""
    numbers[lane] = number
    return numbers


@wp.func
def set_lane(many: Any, lane: wp.int32, those: Any):  # noqa: F811 - an overload
    """The same of two, four or five numbers in each lane."""
    for row in range(len(those)):
        many[row, lane] = those[row]
    return many


@wp.func
def pair(first: float, second: float):
    """Two numbers."""
    return wp.vec2(first, second)


@wp.func
def pair(first: Lanes, second: float):  # noqa: F811 - an overload
    """Two numbers in each lane, of which the second is the same in all."""
    both = Lanes2()
    both[0] = first
    both[1] = Lanes(second)
    return both


@wp.func
def five(a: float, b: float, c: float, d: float, e: float):
    """Five numbers."""
    return Five(a, b, c, d, e)


@wp.func
def five(a: Lanes, b: Lanes, c: Lanes, d: Lanes, e: Lanes):  # noqa: F811 - an overload
    """Five numbers in each lane."""
    all_five = Lanes5()
    all_five[0] = a
    all_five[1] = b
    all_five[2] = c
    all_five[3] = d
    all_five[4] = e
    return all_five


@wp.func
def total_in(numbers: Lanes):
    """The sum over the lanes, in each of them."""
    return Lanes(wp.dot(numbers, Lanes(1.0)))


@wp.func
def total_in(many: Any):  # noqa: F811 - an overload
    """The same of several numbers in each lane."""
    for row in range(len(many)):
        many[row] = Lanes(wp.dot(many[row], Lanes(1.0)))
    return many


# ---- products


@wp.func
def times(a: float, b: float):
    """a b"""
    return a * b


@wp.func
def times(a: Lanes, b: Lanes):  # noqa: F811 - an overload
    """a b in each lane."""
    return wp.cw_mul(a, b)


@wp.func
def times(a: float, b: Lanes):  # noqa: F811 - an overload
    """a b in each lane."""
    return a * b


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
    """a x b in each lane."""
    ...


@wp.func
def dot_product(a: wp.vec3, b: wp.vec3):
    """a . b"""
    return wp.dot(a, b)


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
def dot_product(a: Lanes3, b: Lanes3) -> Lanes:  # noqa: F811 - an overload
    """a . b in each lane."""
    ...


@wp.func
def reach_along(vector: wp.vec3, direction: wp.vec3):
    """How far a vector reaches along a direction."""
    return wp.dot(vector, direction)


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight* p = reinterpret_cast<const eight*>(&vector.data[0][0]);
    wp::vec_t<8, wp::float32> result;
    *reinterpret_cast<eight*>(&result.c[0]) = direction.c[0] * p[0] + direction.c[1] * p[1] + direction.c[2] * p[2];
    return result;
    """
)
def reach_along(vector: Lanes3, direction: wp.vec3) -> Lanes:  # noqa: F811 - an overload
    """How far each lane's vector reaches along a direction."""
    ...


@wp.func
def scaled(vector: wp.vec3, factor: float):
    """A vector times a factor."""
    return factor * vector


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight f = *reinterpret_cast<const eight*>(&factor.c[0]);
    const eight* p = reinterpret_cast<const eight*>(&vector.data[0][0]);
    wp::mat_t<3, 8, wp::float32> result;
    eight* r = reinterpret_cast<eight*>(&result.data[0][0]);
    r[0] = f * p[0];
    r[1] = f * p[1];
    r[2] = f * p[2];
    return result;
    """
)
def scaled(vector: Lanes3, factor: Lanes) -> Lanes3:  # noqa: F811 - an overload
    """Each lane's vector times its own factor."""
    ...


@wp.func_native(
    """
    #pragma clang fp contract(fast)
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight f = *reinterpret_cast<const eight*>(&factor.c[0]);
    const eight* p = reinterpret_cast<const eight*>(&vector.data[0][0]);
    const eight* q = reinterpret_cast<const eight*>(&total.data[0][0]);
    wp::mat_t<3, 8, wp::float32> result;
    eight* r = reinterpret_cast<eight*>(&result.data[0][0]);
    r[0] = q[0] + f * p[0];
    r[1] = q[1] + f * p[1];
    r[2] = q[2] + f * p[2];
    return result;
    """
)
def plus_scaled(total: Lanes3, vector: Lanes3, factor: Lanes) -> Lanes3:
    """A vector and, of another, so much as each lane's own factor says; product and sum at once where a CPU can."""
    ...


@wp.func
def scaled(number: Lanes, factor: Lanes):  # noqa: F811 - an overload
    """Each lane's number times its own factor."""
    return wp.cw_mul(number, factor)


@wp.func
def scaled(fives: Lanes5, factor: Lanes):  # noqa: F811 - an overload
    """Each lane's five numbers times its own factor."""
    for row in range(5):
        fives[row] = wp.cw_mul(fives[row], factor)
    return fives


@wp.func
def scaled(vector: Lanes3, factor: float):  # noqa: F811 - an overload
    """Each lane's vector times one factor."""
    return factor * vector


@wp.func
def length_of(vector: wp.vec3):
    """|v|"""
    return wp.length(vector)


@wp.func
def length_of(vectors: Lanes3):  # noqa: F811 - an overload
    """|v| in each lane."""
    lengths = Lanes()
    for lane in range(LANE_COUNT):
        lengths[lane] = wp.length(of_lane(vectors, lane))
    return lengths


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    wp::vec_t<8, wp::float32> result;
    *reinterpret_cast<eight*>(&result.c[0]) = __builtin_elementwise_max(
        *reinterpret_cast<const eight*>(&a.c[0]), *reinterpret_cast<const eight*>(&b.c[0]));
    return result;
    """
)
def larger(a: Lanes, b: Lanes) -> Lanes:
    """The larger number in each lane."""
    ...


@wp.func
def squared_length(d: wp.vec3):
    """|d|^2, and a little more, so that its root can be divided by."""
    return d[0] * d[0] + (d[1] * d[1] + (d[2] * d[2] + NOT_QUITE_ZERO))


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight* p = reinterpret_cast<const eight*>(&d.data[0][0]);
    wp::vec_t<8, wp::float32> result;
    *reinterpret_cast<eight*>(&result.c[0]) = p[0] * p[0] + (p[1] * p[1] + (p[2] * p[2] + 1.0e-20f));
    return result;
    """
)
def squared_length(d: Lanes3) -> Lanes:  # noqa: F811 - an overload
    """The squared length in each lane, and a little more, so that its root can be divided by. Rounded as that of one
    vector: springs that are hardly longer than at rest then pull alike in every schedule."""
    ...


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    return __builtin_reduce_or(*reinterpret_cast<const eight*>(&lanes.c[0]) < 0.0f) != 0;
    """
)
def any_negative(lanes: Lanes) -> bool:
    """Whether a number is below zero in any of the lanes."""
    ...


@wp.func
def any_positive(number: float):
    """Whether a number is above zero."""
    return number > 0.0


@wp.func
def any_positive(lanes: Lanes):  # noqa: F811 - an overload
    """Whether a number is above zero in any of the lanes."""
    return any_negative(-lanes)


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    return __builtin_reduce_and(*reinterpret_cast<const eight*>(&lanes.c[0]) > 0.0f) != 0;
    """
)
def all_positive(lanes: Lanes) -> bool:
    """Whether the numbers are above zero in all lanes; where one is no number, it is not."""
    ...

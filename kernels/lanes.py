"""Vectors of eight lanes in a CPU's registers: types and functions, with the same names as for one item.

A lane is a world or a particle, see `kernels.schedules.lanes`.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.memory import float_at, int_at

LANE_COUNT = wp.constant(8)
Lanes = wp.types.vector(length=8, dtype=wp.float32)
"""Number in each of eight lanes"""
Lanes2 = wp.types.matrix(shape=(2, 8), dtype=wp.float32)
"""Two numbers in each of eight lanes, a column each"""
Lanes3 = wp.types.matrix(shape=(3, 8), dtype=wp.float32)
"""Vector in each of eight lanes, a column each"""
Lanes4 = wp.types.matrix(shape=(4, 8), dtype=wp.float32)
"""Four numbers in each of eight lanes, a column each"""
Lanes5 = wp.types.matrix(shape=(5, 8), dtype=wp.float32)
"""Five numbers in each of eight lanes, a column each"""
Five = wp.types.vector(length=5, dtype=wp.float32)
"""Five numbers"""
IN_LANES = {
    float: Lanes, wp.float32: Lanes, wp.vec2: Lanes2, wp.vec3: Lanes3, wp.vec4: Lanes4, Five: Lanes5,
}  # fmt: skip
"""Types of eight lanes, by the type of one"""
LaneNumbers = wp.types.vector(length=8, dtype=wp.int32)
"""Index of a particle, or of another item, in each of eight lanes"""


@wp.func
def of_lane(number: float, lane: wp.int32):
    """Return a number that is the same in all lanes."""
    return number


@wp.func
def of_lane(number: wp.int32, lane: wp.int32):  # noqa: F811 - an overload
    """Return a number that is the same in all lanes."""
    return number


@wp.func
def of_lane(vector: wp.vec3, lane: wp.int32):  # noqa: F811 - an overload
    """Return a vector that is the same in all lanes."""
    return vector


@wp.func
def of_lane(numbers: Lanes, lane: wp.int32):  # noqa: F811 - an overload
    """Return the number of one lane."""
    return numbers[lane]


@wp.func
def of_lane(vectors: Lanes3, lane: wp.int32):  # noqa: F811 - an overload
    """Return the vector of one lane."""
    return wp.vec3(vectors[0, lane], vectors[1, lane], vectors[2, lane])


@wp.func
def of_lane(vectors: wp.vec4, lane: wp.int32):  # noqa: F811 - an overload
    """Return a vector that is the same in all lanes."""
    return vectors


@wp.func
def of_lane(vectors: Lanes4, lane: wp.int32):  # noqa: F811 - an overload
    """Return the four numbers of one lane."""
    return wp.vec4(vectors[0, lane], vectors[1, lane], vectors[2, lane], vectors[3, lane])


@wp.func
def of_lane(numbers: LaneNumbers, lane: wp.int32):  # noqa: F811 - an overload
    """Return the number of one lane."""
    return numbers[lane]


@wp.func
def of_lane(pairs: Lanes2, lane: wp.int32):  # noqa: F811 - an overload
    """Return the two numbers of one lane."""
    return wp.vec2(pairs[0, lane], pairs[1, lane])


@wp.func
def of_lane(fives: Lanes5, lane: wp.int32):  # noqa: F811 - an overload
    """Return the five numbers of one lane."""
    return Five(fives[0, lane], fives[1, lane], fives[2, lane], fives[3, lane], fives[4, lane])


@wp.func
def number_in(row: Any, column: wp.int32, lane: wp.int32):
    """Return a number of a row of one particle's."""
    return row[column]


@wp.func
def number_in(row: wp.array[Lanes], column: wp.int32, lane: wp.int32):  # noqa: F811 - an overload
    """Return the number of one lane, of a row of lanes."""
    return row[column][lane]


@wp.func
def set_lane(vectors: Lanes3, lane: wp.int32, vector: wp.vec3):
    """Return the vectors with that of one lane replaced."""
    vectors[0, lane] = vector[0]
    vectors[1, lane] = vector[1]
    vectors[2, lane] = vector[2]
    return vectors


@wp.func
def set_lane(numbers: Lanes, lane: wp.int32, number: float):  # noqa: F811 - an overload
    """Return the numbers with that of one lane replaced."""
    numbers[lane] = number
    return numbers


@wp.func
def set_lane(many: Any, lane: wp.int32, those: Any):  # noqa: F811 - an overload
    """Set two, four or five numbers in one lane."""
    for row in range(len(those)):
        many[row, lane] = those[row]
    return many


@wp.func
def pair(first: float, second: float):
    """Return two numbers."""
    return wp.vec2(first, second)


@wp.func
def pair(first: Lanes, second: float):  # noqa: F811 - an overload
    """Return two numbers in each lane, of which the second is the same in all."""
    both = Lanes2()
    both[0] = first
    both[1] = Lanes(second)
    return both


@wp.func
def five(a: float, b: float, c: float, d: float, e: float):
    """Return five numbers."""
    return Five(a, b, c, d, e)


@wp.func
def five(a: Lanes, b: Lanes, c: Lanes, d: Lanes, e: Lanes):  # noqa: F811 - an overload
    """Return five numbers in each lane."""
    all_five = Lanes5()
    all_five[0] = a
    all_five[1] = b
    all_five[2] = c
    all_five[3] = d
    all_five[4] = e
    return all_five


@wp.func
def total_in(numbers: Lanes):
    """Return the sum over the lanes, in each of them."""
    return Lanes(wp.dot(numbers, Lanes(1.0)))


@wp.func
def total_in(many: Any):  # noqa: F811 - an overload
    """Return the sums of several numbers over all lanes."""
    for row in range(len(many)):
        many[row] = Lanes(wp.dot(many[row], Lanes(1.0)))
    return many


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    return __builtin_reduce_or(*reinterpret_cast<const eight*>(&lanes.c[0]) < 0.0f) != 0;
    """
)
def any_negative(lanes: Lanes) -> bool:
    """Return whether a number is below zero in any of the lanes."""
    ...


@wp.func
def any_positive(number: float):
    """Return whether a number is above zero."""
    return number > 0.0


@wp.func
def any_positive(lanes: Lanes):  # noqa: F811 - an overload
    """Return whether a number is above zero in any of the lanes."""
    return any_negative(-lanes)


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    return __builtin_reduce_and(*reinterpret_cast<const eight*>(&lanes.c[0]) > 0.0f) != 0;
    """
)
def all_positive(lanes: Lanes) -> bool:
    """Return whether the numbers are above zero in all lanes; false where one is NaN."""
    ...


@wp.func
def entry_at(array: wp.array[wp.int32], entry: wp.int32):
    """Return an entry of a contiguous array, which is the same in all lanes."""
    return int_at(array, entry)


@wp.func
def entry_at(array: wp.array[float], entry: wp.int32):  # noqa: F811 - an overload
    """Return a number of a contiguous array."""
    return float_at(array, entry)


@wp.func_native("return array.data[(unsigned int)entry];")
def entry_at(array: wp.array[Lanes], entry: wp.int32) -> Lanes:  # noqa: F811 - an overload
    """Return an entry of a contiguous array for each lane."""
    ...


@wp.func_native("return array.data[(unsigned int)entry];")
def entry_at(array: wp.array[LaneNumbers], entry: wp.int32) -> LaneNumbers:  # noqa: F811 - an overload
    """Return an integer entry of a contiguous array for each lane."""
    ...

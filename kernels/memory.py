"""Reads and writes of memory without the strides and indices from the end for which Warp's own indexing allows.

In a loop over a particle's springs, that would be most of the instructions.
"""

from typing import Any

import warp as wp


@wp.func_native("return array.data[(unsigned int)index];")
def int_at(array: wp.array[wp.int32], index: wp.int32) -> wp.int32:
    """Return `array[index]` of a contiguous array."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __ldg(array.data + (unsigned int)index);
#else
    return array.data[index];
#endif
""")
def fixed_int_at(array: wp.array[wp.int32], index: wp.int32) -> wp.int32:
    """Return `array[index]` of a contiguous array that no kernel writes to, so that a loop may read it once."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __ldg(array.data + (unsigned int)index);
#else
    return array.data[index];
#endif
""")
def fixed_float_at(array: wp.array[float], index: wp.int32) -> float:
    """Return `array[index]` of a contiguous array that no kernel writes to, so that a loop may read it once."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    asm volatile("{ .reg .pred unmet; setp.eq.s32 unmet, %0, 0; @unmet st.global.s32 [%1], %2; }"
        :: "r"((int)condition), "l"(array.data + (unsigned int)index), "r"(value));
#else
    if (!condition)
        array.data[(unsigned int)index] = value;
#endif
""")
def put_int_unless(condition: bool, array: wp.array[wp.int32], index: wp.int32, value: wp.int32):
    """Store an integer in a contiguous array unless a condition holds.

    On a GPU without a branch, which would keep the compiler from mixing the instructions before it and after it.
    """
    ...


@wp.func_native("return array.data[(unsigned int)index];")
def float_at(array: wp.array[float], index: wp.int32) -> float:
    """Return `array[index]` of a contiguous array."""
    ...


@wp.func_native("return array.data[(unsigned int)index];")
def vector_at(array: wp.array[wp.vec3], index: wp.int32) -> wp.vec3:
    """Return `array[index]` of a contiguous array."""
    ...


@wp.func
def add_at(array: wp.array[wp.vec3], index: wp.int32, vector: wp.vec3):
    """Add a vector to one to which others add theirs."""
    wp.atomic_add(array, index, vector)


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const float2 pair = __ldg(reinterpret_cast<const float2*>(array.data) + (unsigned int)index);
    return wp::vec_t<2, wp::float32>(pair.x, pair.y);
#else
    return array.data[index];
#endif
""")
def pair_at(array: wp.array[wp.vec2], index: wp.int32) -> wp.vec2:
    """Return `array[index]` of a contiguous array that no kernel writes to, in one load."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const int2 pair = __ldg(reinterpret_cast<const int2*>(array.data) + (unsigned int)index);
    return wp::vec_t<2, wp::int32>(pair.x, pair.y);
#else
    return array.data[index];
#endif
""")
def int_pair_at(array: wp.array[wp.vec2i], index: wp.int32) -> wp.vec2i:
    """Return two integers of a contiguous array, in one load."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const unsigned int both = __ldg(reinterpret_cast<const unsigned int*>(array.data) + (unsigned int)index);
#else
    const unsigned int both = array.data[index];
#endif
    return wp::vec_t<2, wp::int32>(both & 0xFFFF, both >> 16);
""")
def packed_pair_at(array: wp.array[wp.int32], index: wp.int32) -> wp.vec2i:
    """Return two 16-bit integers of a contiguous array, in one load."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const int4 four = __ldg(reinterpret_cast<const int4*>(array.data) + (unsigned int)index);
    return wp::vec_t<4, wp::int32>(four.x, four.y, four.z, four.w);
#else
    return array.data[index];
#endif
""")
def four_ints_at(array: wp.array[wp.vec4i], index: wp.int32) -> wp.vec4i:
    """Return four integers of a contiguous array, in one load."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const float4 four = __ldg(reinterpret_cast<const float4*>(array.data) + (unsigned int)index);
    return wp::vec_t<4, wp::float32>(four.x, four.y, four.z, four.w);
#else
    return array.data[index];
#endif
""")
def four_floats_at(array: wp.array[wp.vec4], index: wp.int32) -> wp.vec4:
    """Return four numbers of a contiguous array, in one load."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const int4 four = __ldg(reinterpret_cast<const int4*>(array.data) + (unsigned int)index);
    return wp::vec_t<4, wp::int32>(four.x, four.y, four.z, four.w);
#else
    const int* four = array.data + 4 * index;
    return wp::vec_t<4, wp::int32>(four[0], four[1], four[2], four[3]);
#endif
""")
def quad_at(array: wp.array[wp.int32], index: wp.int32) -> wp.vec4i:
    """Return the integers from `array[4 * index]` on, in one load."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    int same;
    asm volatile("mov.b32 %0, %1;" : "=r"(same) : "r"(number));
    return same;
#else
    return number;
#endif
""")
def found_anew(number: wp.int32) -> wp.int32:
    """Return an integer that the GPU's compiler cannot hoist out of a loop.

    Derived values are computed where they are needed, and take no registers until then.
    """
    ...


IN_ROW = "array.data[(size_t)(unsigned int)row * (unsigned int)array.shape[1] + (unsigned int)column]"


@wp.func_native(f"return {IN_ROW};")
def vector_in(array: wp.array2d[wp.vec3], row: wp.int32, column: wp.int32) -> wp.vec3:
    """Return `array[row, column]` of a contiguous array."""
    ...


@wp.func_native(f"return {IN_ROW};")
def float_in(array: wp.array2d[float], row: wp.int32, column: wp.int32) -> float:
    """Return a number of a contiguous array."""
    ...


ON_PAGE = (
    "array.data + ((size_t)(unsigned int)page * (unsigned int)array.shape[1] + (unsigned int)row)"
    " * (unsigned int)array.shape[2] + (unsigned int)column"
)


@wp.func_native(f"""
    const int* const first = {ON_PAGE};
#if defined(__CUDA_ARCH__)
    const int4 four = *reinterpret_cast<const int4*>(first);
    return wp::vec_t<4, wp::int32>(four.x, four.y, four.z, four.w);
#else
    return wp::vec_t<4, wp::int32>(first[0], first[1], first[2], first[3]);
#endif
""")
def four_on_page(array: wp.array3d[wp.int32], page: wp.int32, row: wp.int32, column: wp.int32) -> wp.vec4i:
    """Return `array[page, row, column]` of a contiguous array and the three after it, in one load.

    Rows and columns are whole fours.
    """
    ...


@wp.func
def one_of_four(four: wp.vec4i, number: wp.int32):
    """Return `four[number]`, without the memory that an index needs."""
    return wp.where(number < 2, wp.where(number == 0, four[0], four[1]), wp.where(number == 2, four[2], four[3]))


@wp.func_native(f"{IN_ROW} = value;")
def put_vector_in(array: wp.array2d[wp.vec3], row: wp.int32, column: wp.int32, value: wp.vec3):
    """Store a vector in a contiguous array."""
    ...


@wp.func_native(f"return {IN_ROW};")
def byte_in(array: wp.array2d[wp.int8], row: wp.int32, column: wp.int32) -> wp.int8:
    """Return `array[row, column]` of a contiguous array."""
    ...


@wp.func_native(f"""
    int four;
    memcpy(&four, &{IN_ROW}, sizeof four);
    return four;
""")
def four_bytes_in(array: wp.array2d[wp.int8], row: wp.int32, column: wp.int32) -> wp.int32:
    """Return `array[row, column]` of a contiguous array and the three bytes after it, the first as the lowest.

    Rows and columns are whole fours.
    """
    ...


@wp.func_native(f"return {IN_ROW};")
def two_in(array: wp.array2d[wp.vec2], row: wp.int32, column: wp.int32) -> wp.vec2:
    """Return two numbers of a contiguous array."""
    ...


@wp.func_native(f"""
#if defined(__CUDA_ARCH__)
    const float4 four = *reinterpret_cast<const float4*>(&{IN_ROW});
    return wp::vec_t<4, wp::float32>(four.x, four.y, four.z, four.w);
#else
    return {IN_ROW};
#endif
""")
def four_in(array: wp.array2d[wp.vec4], row: wp.int32, column: wp.int32) -> wp.vec4:
    """Return four numbers of a contiguous array, in one load."""
    ...


@wp.func_native(f"""
#if defined(__CUDA_ARCH__)
    *reinterpret_cast<float4*>(&{IN_ROW}) = make_float4(value[0], value[1], value[2], value[3]);
#else
    {IN_ROW} = value;
#endif
""")
def put_four_in(array: wp.array2d[wp.vec4], row: wp.int32, column: wp.int32, value: wp.vec4):
    """Store four numbers in a contiguous array, in one store."""
    ...


@wp.func_native("return array.data[(unsigned int)index];")
def triple_at(array: wp.array[wp.vec3i], index: wp.int32) -> wp.vec3i:
    """Return `array[index]` of a contiguous array."""
    ...


@wp.func
def in_tile(tile: Any, index: wp.int32):
    """Return `tile[index]`, which has fewer entries than this; so the compiler knows that the index is not negative."""
    return tile[index & 0xFFFF]


@wp.func_native("tile.data.ptr[index] = value;")
def put_in_tile(tile: Any, index: wp.int32, value: Any):
    """Store a point in a shared tile, without a barrier."""
    ...


@wp.func_native("array.data[(unsigned int)index] = value;")
def put_vector(array: wp.array[wp.vec3], index: wp.int32, value: wp.vec3):
    """Store a vector in a contiguous array."""
    ...

"""What the threads of a warp and of a block do together on a GPU. On a CPU a block has one thread."""

from functools import cache
from typing import Any

import warp as wp

WARP_THREADS = wp.constant(32)


SHARED_WORDS = """
#if defined(__CUDA_ARCH__)
    __shared__ float4 words[(COUNT + 3) / 4];
    return (wp::uint64)words;
#else
    static float words[(COUNT + 3) / 4 * 4];
    return (wp::uint64)words;
#endif
"""


@cache
def shared_words(name: str, count: int) -> Any:
    """A function that returns the address of so many words of shared memory, the same ones wherever it is called.

    Args:
        name: what they are for; words of another name are others.
    """

    @wp.func_native(f"// {name}{SHARED_WORDS.replace('COUNT', str(count))}")
    def words() -> wp.uint64:
        """Their address."""
        ...

    return words


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    return __syncthreads_or(here) != 0;
#else
    return here;
#endif
    """
)
def any_in_block(here: bool) -> bool:
    """Whether it is so in any thread of the block; called by all of them, who wait for each other."""
    ...


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    return __any_sync(0xffffffffu, here) != 0;
#else
    return here;
#endif
    """
)
def any_in_warp(here: bool) -> bool:
    """Whether it is so in any thread of the warp; called by all of them."""
    ...


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    for (int apart = 16; apart > 0; apart /= 2) {
        x += __shfl_xor_sync(0xffffffffu, x, apart);
    }
#endif
    return x;
    """
)
def warp_sum(x: float) -> float:
    """The sum over the threads of the warp, in the same order every time; called by all of them."""
    ...


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    for (int apart = 16; apart > 0; apart /= 2) {
        x = fmaxf(x, __shfl_xor_sync(0xffffffffu, x, apart));
    }
#endif
    return x;
    """
)
def warp_max(x: float) -> float:
    """The largest of the threads of the warp; called by all of them."""
    ...


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    // Threads first share the components out among them, so that they add up one number instead of three.
    const bool upper_half = threadIdx.x & 16;
    const bool upper_quarter = threadIdx.x & 8;
    float first = (upper_half ? v[2] : v[0]) + __shfl_xor_sync(0xffffffffu, upper_half ? v[0] : v[2], 16);
    float second = (upper_half ? 0.0f : v[1]) + __shfl_xor_sync(0xffffffffu, upper_half ? v[1] : 0.0f, 16);
    float one = (upper_quarter ? second : first) + __shfl_xor_sync(0xffffffffu, upper_quarter ? first : second, 8);
    for (int apart = 4; apart > 0; apart /= 2) {
        one += __shfl_xor_sync(0xffffffffu, one, apart);
    }
    return wp::vec3(
        __shfl_sync(0xffffffffu, one, 0), __shfl_sync(0xffffffffu, one, 8), __shfl_sync(0xffffffffu, one, 16));
#else
    return v;
#endif
    """
)
def warp_sum_of_vectors(v: wp.vec3) -> wp.vec3:
    """The sum over the threads of the warp, in the same order every time; called by all of them."""
    ...


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    const unsigned all = 0xffffffffu;
    const int lane = threadIdx.x & 31;
    const float* words = (const float*)entries;
    float total = 0.0f;
    for (int first = 0; first < count; first += 8) {
        const bool there = first + lane / 4 < count;
        const float word = there ? words[4 * first + lane] : 0.0f;
        const float its_stamp = __shfl_sync(all, word, lane | 3);
        total += there && its_stamp == stamp ? word : 0.0f;
    }
    if (!__any_sync(all, total != 0.0f)) {
        return wp::vec3();
    }
    for (int apart = 16; apart > 2; apart /= 2) {
        total += __shfl_xor_sync(all, total, apart);
    }
    return wp::vec3(__shfl_sync(all, total, 0), __shfl_sync(all, total, 1), __shfl_sync(all, total, 2));
#else
    const float* words = (const float*)entries;
    return words[3] == stamp ? wp::vec3(words[0], words[1], words[2]) : wp::vec3();
#endif
    """
)
def warp_sum_of_stamped(entries: wp.uint64, count: wp.int32, stamp: float) -> wp.vec3:
    """The sum of the vectors among so many entries of four words whose fourth is the stamp; by all threads of a warp,
    which get the same to the last bit every time."""
    ...


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    return __shfl_sync(0xffffffffu, x, thread);
#else
    return x;
#endif
    """
)
def of_thread(x: wp.int32, thread: wp.int32) -> wp.int32:
    """What a thread of the warp has; called by all of them."""
    ...


@wp.func_native(
    """
    int* const count = counts.data + (unsigned int)(world * counts.shape[1] + which);
#if defined(__CUDA_ARCH__)
    const unsigned beside = __match_any_sync(__activemask(), (unsigned long long)count);
    const int lane = threadIdx.x & 31, first = __ffs(beside) - 1;
    int begin = 0;
    if (lane == first) {
        begin = atomicAdd(count, __popc(beside));
    }
    return __shfl_sync(beside, begin, first) + __popc(beside & ((1u << lane) - 1));
#else
    return (*count)++;
#endif
    """
)
def next_place(counts: wp.array2d[wp.int32], world: wp.int32, which: wp.int32) -> wp.int32:
    """The next place in a list of a world, whose length stands in a contiguous array; in any order. The threads of a
    warp that ask together count once: else all threads of a world would wait for each other at its count."""
    ...


@wp.func_native(
    """
    int* const count = (int*)words + index;
#if defined(__CUDA_ARCH__)
    const unsigned beside = __activemask();
    const int lane = threadIdx.x & 31, first = __ffs(beside) - 1;
    int begin = 0;
    if (lane == first) {
        begin = atomicAdd(count, __popc(beside));
    }
    return __shfl_sync(beside, begin, first) + __popc(beside & ((1u << lane) - 1));
#else
    return (*count)++;
#endif
    """
)
def next_in_block(words: wp.uint64, index: wp.int32) -> wp.int32:
    """The next place in a list of the block, whose length stands in a word of shared memory; in any order."""
    ...


@wp.func_native("return ((const int*)words)[index];")
def count_at(words: wp.uint64, index: wp.int32) -> wp.int32:
    """A whole number in a word of shared memory."""
    ...


@wp.func_native("((int*)words)[index] = count;")
def put_count(words: wp.uint64, index: wp.int32, count: wp.int32):
    """A whole number into a word of shared memory, without a barrier."""
    ...


@wp.func_native("return ((const float*)words)[index];")
def word_at(words: wp.uint64, index: wp.int32) -> float:
    """A word of shared memory."""
    ...


@wp.func_native("((float*)words)[index] = value;")
def put_word(words: wp.uint64, index: wp.int32, value: float):
    """Into a word of shared memory, without a barrier."""
    ...


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    float4 read = ((const float4*)words)[entry];
    return wp::vec4(read.x, read.y, read.z, read.w);
#else
    const float* read = (const float*)words + 4 * entry;
    return wp::vec4(read[0], read[1], read[2], read[3]);
#endif
    """
)
def read_entry(words: wp.uint64, entry: wp.int32) -> wp.vec4:
    """Four words of shared memory."""
    ...


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    ((float4*)words)[entry] = make_float4(v[0], v[1], v[2], fourth);
#else
    float* write = (float*)words + 4 * entry;
    write[0] = v[0]; write[1] = v[1]; write[2] = v[2]; write[3] = fourth;
#endif
    """
)
def write_entry(words: wp.uint64, entry: wp.int32, v: wp.vec3, fourth: float):
    """A vector and a number into four words of shared memory."""
    ...


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
    """
)
def block_barrier():
    """Wait for all threads of the block."""
    ...

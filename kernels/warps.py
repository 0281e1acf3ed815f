"""Cooperation of the threads of a warp and of a block on a GPU.

On a CPU a block has one thread.
"""

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
    """Return a function that returns the address of a number of words of shared memory, the same at each call.

    Args:
        name: their purpose; words of another name are others.
    """

    @wp.func_native(f"// {name}{SHARED_WORDS.replace('COUNT', str(count))}")
    def words() -> wp.uint64:
        """Return the address of the shared words."""
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
    """Return whether a condition holds in any thread of the block.

    All threads call it, and wait for each other.
    """
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
    """Return whether a condition holds in any thread of the warp; called by all of them, which go on together."""
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
    """Return the sum over the threads of the warp, in the same order every time; called by all of them."""
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
    """Return the value that a thread of the warp has; called by all threads of the warp."""
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
    """Return the next free place in a world's list, whose length is in a contiguous array; in any order.

    The threads of a warp that ask together count once: otherwise all threads of a world would wait for each other at
    its counter.
    """
    ...


@wp.func_native("return ((const float*)words)[index];")
def word_at(words: wp.uint64, index: wp.int32) -> float:
    """Return a word of shared memory."""
    ...


@wp.func_native("((float*)words)[index] = value;")
def put_word(words: wp.uint64, index: wp.int32, value: float):
    """Store a word in shared memory, without a barrier."""
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
    """Return the next place in a list of the block, whose length stands in a word of shared memory; in any order."""
    ...


@wp.func_native("return ((const int*)words)[index];")
def count_at(words: wp.uint64, index: wp.int32) -> wp.int32:
    """Return a whole number in a word of shared memory."""
    ...


@wp.func_native("((int*)words)[index] = count;")
def put_count(words: wp.uint64, index: wp.int32, count: wp.int32):
    """Write a whole number into a word of shared memory, without a barrier."""
    ...

"""Sums over the particles of a block on a GPU.

Each warp stores the sums of its own particles in shared memory, and adds up those of all warps. On a CPU a block has
one thread.
"""

from typing import Any

import warp as wp

Five = wp.types.vector(length=5, dtype=wp.float32)


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    // As for vectors: threads share the numbers out among them, two by two, then each adds up one.
    const unsigned all = 0xffffffffu;
    const bool upper_half = threadIdx.x & 16, upper_quarter = threadIdx.x & 8, upper_eighth = threadIdx.x & 4;
    const float a = (upper_half ? v[1] : v[0]) + __shfl_xor_sync(all, upper_half ? v[0] : v[1], 16);
    const float b = (upper_half ? v[3] : v[2]) + __shfl_xor_sync(all, upper_half ? v[2] : v[3], 16);
    float last = v[4] + __shfl_xor_sync(all, v[4], 16);
    const float four = (upper_quarter ? b : a) + __shfl_xor_sync(all, upper_quarter ? a : b, 8);
    last += __shfl_xor_sync(all, last, 8);
    float one = (upper_eighth ? last : four) + __shfl_xor_sync(all, upper_eighth ? four : last, 4);
    one += __shfl_xor_sync(all, one, 2);
    one += __shfl_xor_sync(all, one, 1);
    if ((threadIdx.x & 3) == 0) {
        float& word = ((float*)words)[first + (threadIdx.x & 31) / 4];
        word = one + (added ? word : 0.0f);
    }
#else
    for (int n = 0; n < 5; ++n) {
        float& word = ((float*)words)[first + n];
        word = v[n] + (added ? word : 0.0f);
    }
#endif
    """
)
def put_warp_sums(words: wp.uint64, first: wp.int32, v: Five, added: bool):
    """Store the sums over the threads of the warp in eight shared words from `first` on, or add them there.

    All threads of the warp call it; `sum_of_warp_sums` reads the words.
    """
    ...


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    const unsigned all = 0xffffffffu;
    const int lane = threadIdx.x & 31;
    float total = 0.0f;
    for (int n = lane; n < 8 * count; n += 32) {
        total += ((const float*)words)[first + n];
    }
    total += __shfl_xor_sync(all, total, 16);
    total += __shfl_xor_sync(all, total, 8);
    wp::vec_t<5, float> sums;
    for (int n = 0; n < 4; ++n) {
        sums[n] = __shfl_sync(all, total, 4 * (n & 1) + (n & 2));
    }
    sums[4] = __shfl_sync(all, total, 1);
    return sums;
#else
    wp::vec_t<5, float> sums;
    for (int n = 0; n < 5; ++n) {
        sums[n] = ((const float*)words)[first + n];
    }
    return sums;
#endif
    """
)
def sum_of_warp_sums(words: wp.uint64, first: wp.int32, count: wp.int32) -> Five:
    """Return the sums of all warps' words, bitwise reproducible; called by all threads of a warp."""
    ...


@wp.func
def sum_over_block(part: Any):
    """Return the sum over all threads of a block."""
    return wp.tile_sum(wp.tile(part, preserve_type=True))[0]

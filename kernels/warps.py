"""Cooperation of threads on a GPU: warps, blocks, sums, and forces in fixed point.

On a CPU a block has one thread. Sums over the particles of a block: each warp stores the sums of its own particles in
shared memory, and adds up those of all warps.

Forces as whole numbers of 2^-32 N add up to the same in any order: atomic adds that are bit-reproducible. The range is
2e9 N. A particle's penalty force of 1 mN is rounded by less than float32 rounds it.
"""

from functools import cache
from typing import Any

import warp as wp

QUANTA_PER_NEWTON = wp.constant(wp.float64(2.0**32))
NEWTONS_PER_QUANTUM = wp.constant(2.0**-32)


@wp.func
def quanta(force: float):
    """Return a force [N] as a whole number."""
    return wp.int64(wp.float64(force) * QUANTA_PER_NEWTON)


@wp.func
def newtons(count: wp.int64):
    """Return the force [N] of a whole number."""
    return float(count) * NEWTONS_PER_QUANTUM


@wp.func
def add_quanta(totals: wp.array3d[wp.int64], world: wp.int32, item: wp.int32, force: wp.vec3):
    """Add a force [N] to `totals[world, item]`, of any thread in any order."""
    for axis in range(3):
        wp.atomic_add(totals, world, item, axis, quanta(force[axis]))


@wp.func
def total_newtons(totals: wp.array3d[wp.int64], world: wp.int32, item: wp.int32):
    """Return the sum of the forces added [N]."""
    return wp.vec3(newtons(totals[world, item, 0]), newtons(totals[world, item, 1]), newtons(totals[world, item, 2]))


IN_ROW_OF_FOURS = "4 * ((size_t)(unsigned int)world * (unsigned int)totals.shape[1] + (unsigned int)item)"


@wp.func_native(
    f"""
    const size_t first = {IN_ROW_OF_FOURS};
    wp::vec_t<4, wp::float32> since;
#if defined(__CUDA_ARCH__)
    const ulonglong2* now = reinterpret_cast<const ulonglong2*>(totals.data + first);
    ulonglong2* before = reinterpret_cast<ulonglong2*>(taken.data + first);
    const ulonglong2 now_of[2] = {{now[0], now[1]}}, before_of[2] = {{before[0], before[1]}};
    for (int pair = 0; pair < 2; ++pair) {{
        since[2 * pair] = (float)(long long)(now_of[pair].x - before_of[pair].x) * 0x1p-32f;
        since[2 * pair + 1] = (float)(long long)(now_of[pair].y - before_of[pair].y) * 0x1p-32f;
        before[pair] = now_of[pair];
    }}
#else
    for (int entry = 0; entry < 4; ++entry) {{
        const wp::uint64 now = totals.data[first + entry], before = taken.data[first + entry];
        since[entry] = (float)(wp::int64)(now - before) * 0x1p-32f;
        taken.data[first + entry] = now;
    }}
#endif
    return since;
    """
)
def growth(totals: wp.array3d[wp.int64], taken: wp.array3d[wp.int64], world: wp.int32, item: wp.int32) -> wp.vec4:
    """Return the growth of the four sums `totals[world, item]` since the last call, in newtons or another unit.

    Both arrays are contiguous.

    Sums that grow for ever need no zeros: on a GPU a plain store to an address with recent atomic adds makes every load
    around it wait. Beyond the range they wrap around, and their differences stay right. Four sums are as long as a
    GPU's fetch.
    """
    ...


@wp.func
def set_quanta(totals: wp.array3d[wp.int64], world: wp.int32, item: wp.int32, force: wp.vec3):
    """Overwrite `totals[world, item]` with a force [N]."""
    for axis in range(3):
        totals[world, item, axis] = quanta(force[axis])


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


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    return 32;
#else
    return 1;
#endif
    """
)
def warp_size() -> wp.int32:
    """Return the number of threads of a warp."""
    ...


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    return threadIdx.x & 31;
#else
    return 0;
#endif
    """
)
def thread_of_warp() -> wp.int32:
    """Return the number of a thread in its warp."""
    ...


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    return __ballot_sync(0xffffffffu, here);
#else
    return here;
#endif
    """
)
def votes_of_warp(here: bool) -> wp.int32:
    """Return a bit for each thread of the warp in which a condition holds; called by all of them."""
    ...


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    return __ffs(bits) - 1;
#else
    return __builtin_ctz(bits);
#endif
    """
)
def first_vote(bits: wp.int32) -> wp.int32:
    """Return the number of the lowest bit that is set."""
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
    """Return the largest number of the threads of the warp; called by all of them."""
    ...


QUEUE_WORDS = 128
"""Shared words of a warp's queue: of as many pairs of numbers as two warps have threads"""


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    const unsigned all = __ballot_sync(0xffffffffu, here);
    if (here) {
        const int place = count + __popc(all & ((1u << (threadIdx.x & 31)) - 1));
        ((int2*)words)[threadIdx.x / 32 * 64 + place] = make_int2(pair[0], pair[1]);
    }
    __syncwarp();
    return count + __popc(all);
#else
    return count + here;
#endif
    """
)
def put_in_queue(words: wp.uint64, here: bool, pair: wp.vec2i, count: wp.int32) -> wp.int32:
    """Put the pairs of some threads into the queue of their warp, in shared words, and return its length.

    All threads of the warp call it, and take a warp's pairs out of a queue that has as many.
    """
    ...


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    const int2 pair = ((const int2*)words)[threadIdx.x / 32 * 64 + at + (threadIdx.x & 31)];
    __syncwarp();
    return wp::vec_t<2, wp::int32>(pair.x, pair.y);
#else
    return put_last;
#endif
    """
)
def take_from_queue(words: wp.uint64, at: wp.int32, put_last: wp.vec2i) -> wp.vec2i:
    """Return the pair of each thread of a warp, of those in its queue from a place on; called by all of them.

    On a CPU it is the one that was put there last.
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

"""Notes on particles, a byte each, and lists in shared memory of those that have one. Nobody waits for a place in a
list, as where threads ask for it one by one."""

import warp as wp


@wp.func_native("""
    const size_t count = (size_t)array.shape[0] * array.shape[1];
    wp::uint64 eight = 0;
#if defined(__CUDA_ARCH__)
    if (first + 8 <= count) {
        return *reinterpret_cast<const unsigned long long*>(array.data + first);
    }
#endif
    for (int number = 0; number < 8 && first + number < count; ++number) {
        eight |= (wp::uint64)(unsigned char)array.data[first + number] << 8 * number;
    }
    return eight;
""")
def eight_bytes_in(array: wp.array2d[wp.int8], first: wp.int32) -> wp.uint64:
    """Those of a contiguous array from one on, counted through all rows, a whole eight; 0 after the last."""
    ...


@wp.func_native(
    """
    int* const count = (int*)words;
    int marked = 0;
    for (int byte = 0; byte < 8; ++byte) {
        marked += (marks >> 8 * byte & 255) != 0;
    }
    if (marked > 0) {
#if defined(__CUDA_ARCH__)
        int* next = count + 1 + atomicAdd(count, marked);
#else
        int* next = count + 1 + *count;
        *count += marked;
#endif
        for (int byte = 0; byte < 8; ++byte) {
            if ((marks >> 8 * byte & 255) != 0) {
                *next++ = first + byte;
            }
        }
    }
    """
)
def list_marked(words: wp.uint64, marks: wp.uint64, first: wp.int32):
    """Into a list in shared memory, whose length stands in its first word, the numbers from a first on whose bytes of
    eight are marked; in any order."""
    ...

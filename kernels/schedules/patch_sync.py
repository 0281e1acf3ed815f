"""What blocks of a GPU that run at once tell each other: in entries of four words, whose last is the round that they
belong to. An entry is written and read as a whole, so that nobody has to wait for anything else.

Should blocks not run at once after all, the kernel ends with an error after some ten seconds.
"""

import warp as wp

from balloon_warp.kernels.schedules.warp_sums import Five


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const unsigned long long low = (unsigned long long)__float_as_uint(v[1]) << 32 | __float_as_uint(v[0]);
    const unsigned long long high = (unsigned long long)(unsigned)round << 32 | __float_as_uint(v[2]);
    asm volatile("{ .reg .b128 entry; mov.b128 entry, {%1, %2}; st.relaxed.gpu.global.b128 [%0], entry; }"
        :: "l"(entries.data + place), "l"(low), "l"(high) : "memory");
#endif
""")
def tell(entries: wp.array[wp.vec4], place: wp.int32, round: wp.int32, v: wp.vec3):
    """A vector."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    unsigned long long low, high;
    unsigned looks = 0;
    do {
        if (++looks == 1u << 25) {
            __trap();
        }
        asm volatile("{ .reg .b128 entry; ld.relaxed.gpu.global.b128 entry, [%2]; mov.b128 {%0, %1}, entry; }"
            : "=l"(low), "=l"(high) : "l"(entries.data + place) : "memory");
    } while ((int)(high >> 32) < round);
    return wp::vec3(__uint_as_float((unsigned)low), __uint_as_float((unsigned)(low >> 32)),
        __uint_as_float((unsigned)high));
#else
    return wp::vec3();
#endif
""")
def hear(entries: wp.array[wp.vec4], place: wp.int32, round: wp.int32) -> wp.vec3:
    """What another block tells in that round, once it does, or in a later one."""
    ...


@wp.func
def tell_sums(entries: wp.array[wp.vec4], place: wp.int32, round: wp.int32, sums: Five):
    """Five numbers, in two entries."""
    tell(entries, 2 * place, round, wp.vec3(sums[0], sums[1], sums[2]))
    tell(entries, 2 * place + 1, round, wp.vec3(sums[3], sums[4], 0.0))


@wp.func
def hear_sums(entries: wp.array[wp.vec4], place: wp.int32, round: wp.int32):
    """Those of another block."""
    first = hear(entries, 2 * place, round)
    second = hear(entries, 2 * place + 1, round)
    return Five(first[0], first[1], first[2], second[0], second[1])

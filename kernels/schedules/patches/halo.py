"""Halo exchange between co-resident thread blocks.

An entry has four words, the last of which is its round. It is written and read as a whole, so that no other
synchronization is needed. Should blocks not be co-resident after all, the kernel ends with an error after some ten
seconds.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.memory import put_in_tile
from balloon_warp.kernels.schedules.patches.memory import PatchMemory, PatchSeat
from balloon_warp.kernels.warp_sums import Five

Six = wp.types.vector(length=6, dtype=wp.float32)


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const unsigned long long low = (unsigned long long)__float_as_uint(v[1]) << 32 | __float_as_uint(v[0]);
    const unsigned long long high = (unsigned long long)(unsigned)round << 32 | __float_as_uint(v[2]);
    asm volatile("{ .reg .b128 entry; mov.b128 entry, {%1, %2}; st.relaxed.gpu.global.b128 [%0], entry; }"
        :: "l"(entries.data + place), "l"(low), "l"(high) : "memory");
#endif
""")
def publish(entries: wp.array[wp.vec4], place: wp.int32, round: wp.int32, v: wp.vec3):
    """Publish a vector."""
    ...


def _listening(count: int) -> str:
    """Return the source of a wait for entries, one after the other: their vectors, or zeros for an idle thread.

    The threads of a warp stay together until the last has its entry. With a loop for each, which ends sooner for some
    than for others, a compiler lets the first ones proceed alone to work that only all may do.
    """
    return f"""
#if defined(__CUDA_ARCH__)
    unsigned long long low[{count}] = {{}}, high[{count}] = {{}};
    unsigned looks = 0;
    bool waits = is_needed;
    do {{
        if (++looks == 1u << 25) {{
            __trap();
        }}
        if (waits) {{
            waits = false;
            for (int n = 0; n < {count}; ++n) {{
                asm volatile(
                    "{{ .reg .b128 entry; ld.relaxed.gpu.global.b128 entry, [%2]; mov.b128 {{%0, %1}}, entry; }}"
                    : "=l"(low[n]), "=l"(high[n]) : "l"(entries.data + place + n) : "memory");
                waits |= (int)(high[n] >> 32) < round;
            }}
        }}
    }} while (__any_sync(0xffffffffu, waits));
    wp::vec_t<{3 * count}, float> heard;
    for (int n = 0; n < {count}; ++n) {{
        heard[3 * n] = __uint_as_float((unsigned)low[n]);
        heard[3 * n + 1] = __uint_as_float((unsigned)(low[n] >> 32));
        heard[3 * n + 2] = __uint_as_float((unsigned)high[n]);
    }}
    return heard;
#else
    return wp::vec_t<{3 * count}, float>();
#endif
"""


@wp.func_native(_listening(1))
def wait_for(entries: wp.array[wp.vec4], place: wp.int32, round: wp.int32, is_needed: bool) -> wp.vec3:
    """Wait for another block's entry of a round, or of a later one; called by all threads of a warp."""
    ...


@wp.func_native(_listening(2))
def wait_for_two(entries: wp.array[wp.vec4], place: wp.int32, round: wp.int32, is_needed: bool) -> Six:
    """Wait for two entries of another block."""
    ...


@wp.func
def publish_sums(entries: wp.array[wp.vec4], place: wp.int32, round: wp.int32, sums: Five):
    """Publish five numbers, in two entries."""
    publish(entries, 2 * place, round, wp.vec3(sums[0], sums[1], sums[2]))
    publish(entries, 2 * place + 1, round, wp.vec3(sums[3], sums[4], 0.0))


@wp.func
def wait_for_sums(entries: wp.array[wp.vec4], place: wp.int32, round: wp.int32, is_needed: bool):
    """Wait for the sums of another block; called by all threads of a warp."""
    heard = wait_for_two(entries, 2 * place, round, is_needed)
    return Five(heard[0], heard[1], heard[2], heard[3], heard[4])


@wp.func
def exchange(
    memory: PatchMemory,
    seat: PatchSeat,
    substep: wp.int32,
    count: wp.int32,
    particle: wp.int32,
    point: wp.vec3,
    points: Any,
    threads: wp.int32,
):
    """Exchange the positions of halo particles with the blocks around, after a substep."""
    row = ((substep & 1) * seat.slots + seat.slot) * count
    if seat.is_published:
        publish(memory.points, row + particle, substep + 1, point)
    at_halo = wait_for(memory.points, row + seat.halo, substep + 1, seat.halo >= 0)
    if seat.halo >= 0:
        put_in_tile(points, threads + seat.thread, at_halo)

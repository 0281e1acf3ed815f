"""Forces as whole numbers of 2^-32 N, which add up to the same in any order: atomic adds that are bit-reproducible.

The range is 2e9 N. A particle's penalty force of 1 mN is rounded by less than float32 rounds it.
"""

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

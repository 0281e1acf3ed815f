"""Forces as whole numbers of 2^-32 N, which add up to the same in any order: atomic adds that are bit-reproducible.

The range is 2e9 N. A particle's penalty force of 1 mN is rounded by less than float32 rounds it.
"""

import warp as wp

QUANTA_PER_NEWTON = wp.constant(wp.float64(2.0**32))
NEWTONS_PER_QUANTUM = wp.constant(2.0**-32)


@wp.func
def quanta(force: float):
    """A force [N] as a whole number."""
    return wp.int64(wp.float64(force) * QUANTA_PER_NEWTON)


@wp.func
def newtons(count: wp.int64):
    """The force [N] of a whole number."""
    return float(count) * NEWTONS_PER_QUANTUM


@wp.func
def add_quanta(totals: wp.array3d[wp.int64], world: wp.int32, item: wp.int32, force: wp.vec3):
    """Add a force [N] to `totals[world, item]`, of any thread in any order."""
    for axis in range(3):
        wp.atomic_add(totals, world, item, axis, quanta(force[axis]))


@wp.func
def total_newtons(totals: wp.array3d[wp.int64], world: wp.int32, item: wp.int32):
    """The sum of the forces added [N]."""
    return wp.vec3(newtons(totals[world, item, 0]), newtons(totals[world, item, 1]), newtons(totals[world, item, 2]))


@wp.func
def growth(totals: wp.array2d[wp.int64], taken: wp.array2d[wp.int64], world: wp.int32, item: wp.int32):
    """What has been added since the last time, in newtons or whatever a whole number stands for.

    Sums that grow for ever need no zeros: on a GPU a plain store to where atomic adds have just been makes every load
    around it wait. Beyond the range they begin anew, and their differences stay as they are.
    """
    total = totals[world, item]
    since = newtons(total - taken[world, item])
    taken[world, item] = total
    return since


@wp.func
def growth_by_axes(totals: wp.array3d[wp.int64], taken: wp.array3d[wp.int64], world: wp.int32, item: wp.int32):
    """The same of forces, which stand at `totals[world, axis, item]` [N]."""
    return wp.vec3(
        growth(totals[world], taken[world], 0, item),
        growth(totals[world], taken[world], 1, item),
        growth(totals[world], taken[world], 2, item),
    )


@wp.func
def set_quanta(totals: wp.array3d[wp.int64], world: wp.int32, item: wp.int32, force: wp.vec3):
    """Overwrite `totals[world, item]` with a force [N]."""
    for axis in range(3):
        totals[world, item, axis] = quanta(force[axis])

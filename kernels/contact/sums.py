"""Impulses of contacts, added up as whole numbers, the same in any order."""

import warp as wp

QUANTA = wp.constant(wp.float64(2.0**40))
"""Quanta in 1 N s, in 1 N m s, or in 1 kg m: a range of 8e6, and a resolution of 1e-6 m/s for a particle of 1 mg"""
ONE = wp.constant(wp.float64(2.0**-40))


@wp.func
def whole(amount: float):
    """Return an amount as a whole number."""
    return wp.int64(wp.float64(amount) * QUANTA)


@wp.func
def taken(sums: wp.array3d[wp.int64], world: wp.int32, item: wp.int32, axis: wp.int32):
    """Return a sum, and clear it."""
    total = sums[world, item, axis]
    sums[world, item, axis] = wp.int64(0)
    return float(wp.float64(total) * ONE)


@wp.func
def add_impulse(sums: wp.array3d[wp.int64], world: wp.int32, item: wp.int32, impulse: wp.vec3):
    """Add an impulse [N s] to a particle's."""
    for axis in range(3):
        wp.atomic_add(sums, world, item, axis, whole(impulse[axis]))


@wp.func
def add_to_solid(sums: wp.array3d[wp.int64], world: wp.int32, solid: wp.int32, impulse: wp.vec3, twist: wp.vec3):
    """Add an impulse [N s] and an angular momentum [N m s] to those of a body or a sphere."""
    for axis in range(3):
        wp.atomic_add(sums, world, solid, axis, whole(impulse[axis]))
        wp.atomic_add(sums, world, solid, axis + 3, whole(twist[axis]))


@wp.func
def take_impulse(sums: wp.array3d[wp.int64], world: wp.int32, item: wp.int32):
    """Take the impulse on a particle [N s]."""
    return wp.vec3(taken(sums, world, item, 0), taken(sums, world, item, 1), taken(sums, world, item, 2))


@wp.func
def take_of_solid(sums: wp.array3d[wp.int64], world: wp.int32, solid: wp.int32):
    """Take the impulse on a body or a sphere [N s], and the angular momentum [N m s]."""
    impulse = take_impulse(sums, world, solid)
    twist = wp.vec3(taken(sums, world, solid, 3), taken(sums, world, solid, 4), taken(sums, world, solid, 5))
    return impulse, twist

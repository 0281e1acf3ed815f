"""Sums of derivatives that come from anywhere in any order, and are the same to the bit: as whole numbers.

Derivatives have no unit that would say how large they are. So all is gone through twice: the largest of a kind in a
world is found first, and then each is added as a whole number of its 2^44th part. A sum has room for half a million as
large as that.
"""

import warp as wp

PARTS = wp.constant(wp.float64(2.0**44))
"""Parts into which the largest is divided"""
NOTHING = wp.constant(wp.float64(0.0))


@wp.func
def note_size(largest: wp.array2d[float], world: wp.int32, kind: wp.int32, size: float):
    """Note the size of a part of the sums of a kind, by any thread in any order."""
    if not wp.isfinite(size):
        wp.atomic_max(largest, world, kind, wp.inf)
    elif size > 0.0:
        wp.atomic_max(largest, world, kind, size)


@wp.func
def parts_per_unit(largest: wp.array2d[float], world: wp.int32, kind: wp.int32):
    """Return the whole numbers in one of the sums of a kind; 0 if all are nothing, or one is not finite."""
    most = wp.float64(largest[world, kind])
    return wp.where(most > NOTHING, PARTS / wp.max(most, wp.float64(1.0e-300)), NOTHING)


@wp.func
def add_exactly(
    sums: wp.array3d[wp.int64], world: wp.int32, item: wp.int32, entry: wp.int32, per_unit: wp.float64, value: float
):
    """Add to a sum of an item, by any thread in any order."""
    if value != 0.0 and per_unit > NOTHING:
        wp.atomic_add(sums, world, item, entry, wp.int64(wp.float64(value) * per_unit))


@wp.func
def sum_at(
    sums: wp.array3d[wp.int64], largest: wp.array2d[float], world: wp.int32, item: wp.int32, entry: wp.int32,
    kind: wp.int32,
):  # fmt: skip
    """Return a sum of an item; infinity if a part of any was not finite."""
    most = largest[world, kind]
    if not wp.isfinite(most):
        return most
    return float(wp.float64(sums[world, item, entry]) * (wp.float64(most) / PARTS))

"""Sums over items of a balloon, in the same order for eight worlds and for eight particles of one.

Eight particles add up lane by lane, and then lanes do. So worlds have eight sums each, and every eighth particle adds
to the same one.
"""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, total_in
from balloon_warp.kernels.schedules.lanes.layouts import Layout

PARTS = int(LANE_COUNT)
OVER_ITEMS = {"load": 2, "keyed": 2, "gas_mass": 1}
"""Bars of a balloon's values to which items add, and how many numbers they have"""


class Sums(NamedTuple):
    """Places of sums: those of the balloon's values, then of the numbers that are derived by."""

    numbers: int

    @property
    def total(self) -> int:
        """Return how many there are."""
        return sum(OVER_ITEMS.values()) + self.numbers

    def places(self, name: str) -> range:
        """Return the places of a balloon's value."""
        names = list(OVER_ITEMS)
        begin = sum(OVER_ITEMS[each] for each in names[: names.index(name)])
        return range(begin, begin + OVER_ITEMS[name])

    def of_number(self, place: int) -> int:
        """Return the place of a number."""
        return sum(OVER_ITEMS.values()) + place


@wp.func_native("sums.data[((unsigned int)slot * sums.shape[1] + number) * 8 + (unsigned int)item % 8u] += value;")
def add_every_eighth(sums: wp.array3d[Lanes], slot: wp.int32, number: wp.int32, item: wp.int32, value: Lanes):
    """Add to the sum of every eighth item."""
    ...


@wp.func_native("sums.data[((unsigned int)slot * sums.shape[1] + number) * 8] += value;")
def add_each(sums: wp.array3d[Lanes], slot: wp.int32, number: wp.int32, item: wp.int32, value: Lanes):
    """Add to the sum of all items."""
    ...


@wp.func
def clear_sum(sums: wp.array3d[Lanes], slot: wp.int32, number: wp.int32):
    """Begin again."""
    for part in range(PARTS):
        sums[slot, number, part] = Lanes()


@wp.func
def total_of_worlds(sums: wp.array3d[Lanes], slot: wp.int32, number: wp.int32):
    """Return the sum of each of eight worlds."""
    total = Lanes()
    for part in range(PARTS):
        total += sums[slot, number, part]
    return total


@wp.func
def total_of_octets(sums: wp.array3d[Lanes], slot: wp.int32, number: wp.int32):
    """Return the sum of a world, in each lane."""
    return total_in(sums[slot, number, 0])


@cache
def sum_functions(layout: Layout) -> dict[str, Any]:
    """Return the functions that add up, by their names."""
    return {
        "add_to": add_every_eighth if layout.worlds else add_each,
        "total_of": total_of_worlds if layout.worlds else total_of_octets,
        "clear_sum": clear_sum,
    }

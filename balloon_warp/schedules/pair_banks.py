"""Which thread of a block has which pair of quads, and which of the two is the first, so that the loads of a warp meet
in few banks of shared memory; see `schedules.banks`."""

import random
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from balloon_warp.schedules.banks import BANKS
from balloon_warp.schedules.film_banks import HALF_WARP, QUARTER_WARP, begun
from balloon_warp.schedules.membranes import MembraneQuads
from balloon_warp.schedules.memoize import memoized

EXCHANGED = [5, 2, 1, 4, 3, 0]
"""corners of quads abcd and befc if the second is the first, fcbe, and the first the second, cdab"""
ROUNDS = 2
EXCHANGES = 50
"""of pairs that are tried, for each pair"""


def quads_of_pairs(quads: MembraneQuads, pairs: NDArray[np.int64]) -> MembraneQuads:
    """The same faces of four triangles: the first of all pairs, then the second, each turned as `paired` says."""
    order, turns = pairs[:, :2].T.ravel(), pairs[:, 2:].T.ravel()
    return begun(MembraneQuads._make(each[order] for each in quads), turns)


def quads_in_pairs(quads: MembraneQuads, pairs: NDArray[np.int64]) -> MembraneQuads:
    """The same dealt out to threads: so are the first, and so the second, some of which were first."""
    dealt = dealt_pairs(corners_of_pairs(quads_of_pairs(quads, pairs)))
    return quads_of_pairs(quads, pairs_dealt_out(pairs, dealt))


def pairs_dealt_out(pairs: NDArray[np.int64], dealt: NDArray[np.int64]) -> NDArray[np.int64]:
    """The same in the order of threads.

    Args:
        dealt: the pair of each thread, and whether its quads are exchanged, shape (n, 2).
    """
    ordered = pairs[dealt[:, 0]]
    return np.where(dealt[:, 1:] > 0, ordered[:, [1, 0, 3, 2]] + [0, 0, 2, 2], ordered)


def corners_of_pairs(quads: MembraneQuads) -> NDArray[np.int64]:
    """The particles at a, b, c, d, e and f of quads abcd and befc, of which all first come first, shape (n, 6)."""
    first, second = quads.corners.reshape(2, -1, 4)
    return np.concatenate([first, second[:, 1:3]], axis=1)


@memoized
def dealt_pairs(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """The pair of each thread, and whether its quads are exchanged, shape (n, 2).

    First pairs are dealt out to warps, with whose points their own share few banks. Then they change places in their
    warps, so that particles that stand together find what pairs do to them in many banks.

    Args:
        corners: see `corners_of_pairs`.
    """
    both = np.stack([corners, corners[:, EXCHANGED]], axis=1)
    warps, exchanged = _dealt_to_warps(both % BANKS)
    order = np.argsort(warps, kind="stable")
    order = order[_places_in_warps(corners[order])]
    return np.stack([order, exchanged[order]], axis=1)


def _dealt_to_warps(banks: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The warp of each pair, and whether its quads are exchanged: that with which the cubes of the banks' loads grow
    least. All warps but the last get as many as they have threads.

    Args:
        banks: of each pair's corners, both ways, shape (n, 2, 6).
    """
    count, _, corner_count = banks.shape
    free = np.full(-(-count // BANKS), BANKS)
    free[-1] -= len(free) * BANKS - count
    loads = np.zeros((len(free), corner_count, BANKS), dtype=np.int64)
    warp, corner = np.arange(len(free))[:, None, None], np.arange(corner_count)
    chosen = np.full((2, count), -1)
    for _ in range(ROUNDS):
        for pair in range(count):
            here, way = chosen[:, pair]
            if here >= 0:
                loads[here, corner, banks[pair, way]] -= 1
                free[here] += 1
            load = loads[warp, corner, banks[pair]]
            more = (3 * load * (load + 1) + 1).sum(axis=-1)
            more[free == 0] = np.iinfo(np.int64).max
            here, way = np.unravel_index(more.argmin(), more.shape)
            loads[here, corner, banks[pair, way]] += 1
            free[here] -= 1
            chosen[:, pair] = here, way
    return chosen[0], chosen[1]


def _places_in_warps(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """The pair at each place, of pairs that stand in the order of their warps.

    A search: two pairs of a warp are exchanged, again and again, and the exchange is kept if the squares of the banks'
    loads do not add up to more.
    """
    count, choose = len(corners), random.Random(0)
    most = int(corners.max()) + 1
    of_halves, of_quarters = ([0] * (most + size * size) for size in (HALF_WARP, QUARTER_WARP))
    halves, quarters = (
        (corners // size * size).tolist() for size in (HALF_WARP, QUARTER_WARP)
    )  # where the loads of their banks begin

    def loads(pair: int, place: int) -> Iterator[tuple[list[int], int]]:
        """All that a pair counts for at a place."""
        for first in halves[pair]:
            yield of_halves, first + place % HALF_WARP
        for first in quarters[pair]:
            yield of_quarters, first + place % QUARTER_WARP

    def put(pair: int, place: int) -> int:
        """By how much half the squares grow."""
        more = 0
        for table, bank in loads(pair, place):
            more += table[bank]
            table[bank] += 1
        return more

    def take(pair: int, place: int) -> int:
        """By how much they fall."""
        less = 0
        for table, bank in loads(pair, place):
            table[bank] -= 1
            less += table[bank]
        return less

    order = list(range(count))
    for pair in order:
        put(pair, pair)
    for _ in range(EXCHANGES * count):
        place = choose.randrange(count)
        begin = place - place % BANKS
        other = begin + choose.randrange(min(BANKS, count - begin))
        one, two = order[place], order[other]
        if take(one, place) + take(two, other) >= put(one, other) + put(two, place):
            order[place], order[other] = two, one
        else:
            for pair, there, back in ((one, other, place), (two, place, other)):
                take(pair, there)
                put(pair, back)
    return np.array(order)

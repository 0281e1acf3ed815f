"""Where faces of membranes begin, and in which order a particle reads what they do to it, so that the loads of a warp
meet in few banks of shared memory; see `schedules.banks`."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.schedules.banks import turned_over_banks
from balloon_warp.schedules.membranes import MembraneQuads
from balloon_warp.schedules.memoize import memoized

HALF_WARP, QUARTER_WARP = 16, 8
"""threads whose loads of two and of four words are one wavefront: entries meet that are alike modulo these"""
SEARCH_STEPS = 1500
FULLEST = 5


def turned_quads(quads: MembraneQuads, particle_count: int) -> MembraneQuads:
    """The same faces of four triangles, each begun with that of its corners with which a warp's loads of points meet
    least."""
    count = len(quads.corners)
    rings = np.full((1, 4, max(count, particle_count)), -1)
    rings[0, :, :count] = quads.corners.T
    first = turned_over_banks(rings)[0, 0, :count]
    turns = (quads.corners == first[:, None]).argmax(axis=1)
    return begun(quads, turns)


def begun(quads: MembraneQuads, turns: NDArray[np.int64]) -> MembraneQuads:
    """The same faces of four triangles, each begun with another of its corners."""
    order = (turns[:, None] + np.arange(4)) % 4
    return quads._replace(
        corners=np.take_along_axis(quads.corners, order, axis=1),
        rests=np.take_along_axis(quads.rests, order[..., None], axis=1),
        numbers=np.take_along_axis(quads.numbers, order, axis=1),
    )


@memoized
def spread_places(places: NDArray[np.int64]) -> NDArray[np.int64]:
    """The places that each particle reads in each slot, shape (slot_count, particle_count), -1 where there is none, in
    another order of each particle's slots.

    A search: in each half of a warp, two slots of one particle are exchanged, again and again, and the exchange is kept
    if there are not more wavefronts, which count `FULLEST` times, and squares of the banks' loads.
    """
    slots, count = places.shape
    if slots < 2:
        return places
    halves = -(-count // HALF_WARP)
    padded = np.full((slots, halves * HALF_WARP), -1)
    padded[:, :count] = places
    read = padded.reshape(slots, halves, HALF_WARP)
    of_halves = np.zeros((halves, slots, HALF_WARP), dtype=np.int64)
    of_quarters = np.zeros((halves, 2, slots, QUARTER_WARP), dtype=np.int64)

    def change(half: NDArray, thread: NDArray, slot: NDArray, place: NDArray, by: int) -> None:
        there = place >= 0
        half, thread, slot, place = half[there], thread[there], slot[there], place[there]
        np.add.at(of_halves, (half, slot, place % HALF_WARP), by)
        np.add.at(of_quarters, (half, thread // QUARTER_WARP, slot, place % QUARTER_WARP), by)

    def cost(thread: NDArray, slot: NDArray) -> NDArray:
        halves_then, quarters_then = of_halves[every, slot], of_quarters[every, thread // QUARTER_WARP, slot]
        wavefronts = halves_then.max(axis=-1) + quarters_then.max(axis=-1)
        return FULLEST * wavefronts + (halves_then**2).sum(axis=-1) + (quarters_then**2).sum(axis=-1)

    every = np.arange(halves)
    slot, half, thread = (each.ravel() for each in np.indices(read.shape))
    change(half, thread, slot, read.ravel(), 1)
    random = np.random.default_rng(0)
    for _ in range(SEARCH_STEPS):
        thread = random.integers(HALF_WARP, size=halves)
        first = random.integers(slots, size=halves)
        second = (first + 1 + random.integers(slots - 1, size=halves)) % slots
        one, other = read[first, every, thread], read[second, every, thread]
        before = cost(thread, first) + cost(thread, second)
        for slot, place, by in ((first, one, -1), (second, other, -1), (first, other, 1), (second, one, 1)):
            change(every, thread, slot, place, by)
        worse = cost(thread, first) + cost(thread, second) > before
        back = every[worse], thread[worse]
        for slot, place, by in ((first, other, -1), (second, one, -1), (first, one, 1), (second, other, 1)):
            change(*back, slot[worse], place[worse], by)
        half, thread, first, second = (each[~worse] for each in (every, thread, first, second))
        read[first, half, thread], read[second, half, thread] = other[~worse], one[~worse]
    return read.reshape(slots, -1)[:, :count]

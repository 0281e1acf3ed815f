"""Assignment of neighbors to slots and of particles to threads that avoids bank conflicts in shared memory.

Shared memory has 32 banks, a word wide. A point is three words, so that particle p starts in bank 3 p mod 32, and two
particles share their banks if they are equal mod 32. In one load, the 32 threads of a warp each read a neighbor: it
takes as many wavefronts a word as there are different neighbors in the fullest bank. Which of its neighbors a particle
reads in which of its slots is free, and a local search spreads them.
"""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.schedules.memoize import memoized

BANKS = 32
SEARCH_STEPS = 1500


def wavefronts(neighbors: NDArray[np.int64]) -> float:
    """Return the wavefronts a word that a load takes, on average; 1 without conflicts.

    Args:
        neighbors: the particle that each reads in each slot, shape (slot_count, particle_count).
    """
    slots, count = neighbors.shape
    groups = -(-count // BANKS)
    loaded = np.zeros((slots, groups, count), dtype=bool)
    loaded[np.arange(slots)[:, None], np.arange(count) // BANKS, neighbors] = True
    padded = np.zeros((slots, groups, groups * BANKS), dtype=bool)
    padded[..., :count] = loaded
    return float(padded.reshape(slots, groups, groups, BANKS).sum(axis=2).max(axis=2).mean())


@memoized
def spread_over_banks(neighbors: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return an order of each particle's slots, shape (slot_count, particle_count): `take_along_axis` applies it.

    A search: in each warp, two slots of one particle are exchanged, again and again, and the exchange is kept if the
    cubes of the banks' loads do not add up to more.
    """
    slots, count = neighbors.shape
    order = np.repeat(np.arange(slots)[:, None], count, axis=1)
    if slots < 2:
        return order
    groups = -(-count // BANKS)
    group = np.arange(groups)
    current = neighbors.copy()
    readers = np.zeros((groups, slots, count), dtype=np.int32)
    np.add.at(readers, (np.arange(count) // BANKS, np.arange(slots)[:, None], current), 1)
    loads = np.zeros((groups, slots, BANKS), dtype=np.int32)
    np.add.at(loads, (*np.nonzero(readers)[:2], np.nonzero(readers)[2] % BANKS), 1)

    def move(chosen: NDArray, particle: NDArray, source: NDArray, target: NDArray) -> None:
        """Swap the slots in which a thread of each chosen group reads a particle."""
        bank = particle % BANKS
        readers[chosen, source, particle] -= 1
        loads[chosen, source, bank] -= readers[chosen, source, particle] == 0
        loads[chosen, target, bank] += readers[chosen, target, particle] == 0
        readers[chosen, target, particle] += 1

    random = np.random.default_rng(0)
    for _ in range(SEARCH_STEPS):
        particle = np.minimum(group * BANKS + random.integers(BANKS, size=groups), count - 1)
        first = random.integers(slots, size=groups)
        second = (first + 1 + random.integers(slots - 1, size=groups)) % slots
        one, other = current[first, particle], current[second, particle]
        cells = (group, np.stack([first, second, first, second]), np.stack([one, one, other, other]) % BANKS)
        before = (loads[cells] ** 3).sum(axis=0)
        move(group, one, first, second)
        move(group, other, second, first)
        worse = (loads[cells] ** 3).sum(axis=0) > before
        move(group[worse], one[worse], second[worse], first[worse])
        move(group[worse], other[worse], first[worse], second[worse])
        kept = ~worse
        p, a, b = particle[kept], first[kept], second[kept]
        current[a, p], current[b, p] = current[b, p], current[a, p]
        order[a, p], order[b, p] = order[b, p], order[a, p]
    return order

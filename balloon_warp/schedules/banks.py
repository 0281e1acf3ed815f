"""Which slot each neighbor of a particle is loaded in, and which thread of a warp has it, so that the loads of a warp
meet in few banks of shared memory.

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
    """Wavefronts a word that a load takes, on average; 1 without conflicts.

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
    """An order of each particle's slots, shape (slot_count, particle_count): `take_along_axis` applies it.

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
        """Let a thread of each chosen group read a particle in another slot."""
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


TURN_ROUNDS = 2


@memoized
def turned_over_banks(rings: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rings of neighbors that begin elsewhere, shape (ring_count, slot_count, particle_count); -1 where there are no
    more.

    Thread by thread, in all warps at once, each particle's rings are turned together so that what it reads adds least
    to the banks that are read most along with it.
    """
    kinds, slots, count = rings.shape
    if slots < 2:
        return rings
    warps = -(-count // BANKS)
    sizes = (rings[0] >= 0).sum(axis=0)
    kind, slot, warp = np.ogrid[:kinds, :slots, :warps]
    readers = np.zeros((kinds, slots, warps, count), dtype=np.int8)
    loads = np.zeros((kinds, slots, warps, BANKS), dtype=np.int64)
    turns = np.zeros(count, dtype=np.int64)

    def reads(particle: NDArray, turn: NDArray) -> tuple[NDArray, NDArray]:
        """The neighbor in each slot, and whether there is one."""
        size = np.maximum(sizes[particle], 1)
        return rings[kind, (slot + turn) % size, particle], np.broadcast_to(
            slot < sizes[particle], (kinds, slots, warps)
        )

    def read(particle: NDArray, there: NDArray, by: int) -> None:
        first = there & (readers[kind, slot, warp, particle] == (by < 0))
        loads[kind, slot, warp, particle % BANKS] += np.where(first, by, 0)
        readers[kind, slot, warp, particle] += np.where(there, by, 0).astype(np.int8)

    for turn_round in range(TURN_ROUNDS):
        for thread in range(BANKS):
            particle = np.arange(warps) * BANKS + thread
            inside = particle < count
            particle = np.minimum(particle, count - 1)
            if turn_round:
                neighbors, there = reads(particle, turns[particle])
                read(neighbors, there & inside, -1)
            costs = np.zeros((slots, warps), dtype=np.int64)
            for turn in range(slots):
                neighbors, there = reads(particle, np.full(warps, turn))
                load = loads[kind, slot, warp, neighbors % BANKS]
                more = 3 * load * (load + 1) + 1  # of the sum of the cubes
                costs[turn] = np.where(there & (readers[kind, slot, warp, neighbors] == 0), more, 0).sum(axis=(0, 1))
            best = np.where(inside, costs.argmin(axis=0), turns[particle])
            turns[particle] = best
            neighbors, there = reads(particle, best)
            read(neighbors, there & inside, 1)
    size = np.maximum(sizes, 1)
    places = np.arange(slots)[:, None]
    return np.where(places < sizes, np.take_along_axis(rings, ((places + turns) % size)[None].repeat(kinds, 0), 1), -1)


LANE_ROUNDS = 1
PARTS = 4
"""of the warps, which are dealt out anew one after the other"""


@memoized
def spread_over_lanes(order: NDArray[np.int64], neighbors: NDArray[np.int64]) -> NDArray[np.int64]:
    """The particles in an order in which those of each warp stay in it, but in other places, shape (particle_count,).

    A warp's particles are dealt out over its places one after the other, those that are read most often first: each
    gets the place whose bank is least loaded by what is read along with it. All warps do so at once, and then parts of
    them again, when they know of the others.

    Args:
        order: the particle at each place.
        neighbors: the particle that each reads in each slot, -1 if none, shape (slot_count, particle_count).
    """
    count = len(order)
    warps = count // BANKS  # a last one that is not full stays as it is
    if warps == 0:
        return order
    every = order[: warps * BANKS]
    loads_of, group_count = _loads_of_particles(every, neighbors, count)
    members = every.reshape(warps, BANKS)
    reads = (loads_of < group_count).sum(axis=1)
    members = np.take_along_axis(members, np.argsort(-reads[members], axis=1, kind="stable"), axis=1)
    loads = np.zeros((group_count + 1, BANKS), dtype=np.int64)
    bank = np.zeros(count, dtype=np.int64)

    def deal(chosen: NDArray) -> None:
        free = np.ones((len(chosen), BANKS), dtype=bool)
        for turn in range(BANKS):
            particle = members[chosen, turn]
            groups = loads_of[particle]
            load = loads[groups]
            more = (3 * load * (load + 1) + 1).sum(axis=1)  # of the sum of the cubes
            more[~free] = np.iinfo(np.int64).max
            bank[particle] = more.argmin(axis=1)
            free[np.arange(len(chosen)), bank[particle]] = False
            change(particle, 1)

    def change(particles: NDArray, by: int) -> None:
        np.add.at(loads, (loads_of[particles], bank[particles][:, None]), by)
        loads[group_count] = 0  # stands for no load

    deal(np.arange(warps))
    for part in np.tile(np.arange(PARTS), LANE_ROUNDS):
        chosen = np.arange(part, warps, PARTS)
        change(members[chosen].ravel(), -1)
        deal(chosen)
    placed = order.copy()
    placed[(np.arange(warps)[:, None] * BANKS + bank[members]).ravel()] = members.ravel()
    return placed


def _loads_of_particles(every: NDArray[np.int64], neighbors: NDArray[np.int64], count: int) -> tuple[NDArray, int]:
    """By which loads, of a warp and a slot, each particle is read, shape (count, most), filled up with the number of
    loads that there are, which is the second."""
    read = neighbors[:, every].reshape(len(neighbors), -1, BANKS)
    loads = np.arange(read.shape[0] * read.shape[1]).reshape(read.shape[:2])
    there = read >= 0
    load, particle = np.divmod(np.unique((count * loads[..., None] + read)[there]), count)
    by_particle = np.argsort(particle, kind="stable")
    load, particle = load[by_particle], particle[by_particle]
    counts = np.bincount(particle, minlength=count)
    table = np.full((count, counts.max()), loads.size)
    table[particle, np.arange(len(particle)) - np.repeat(np.cumsum(counts) - counts, counts)] = load
    return table, loads.size

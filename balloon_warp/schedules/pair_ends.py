"""Which thread of a block has which pair of quads, where each has the particles at the ends of the edge that its pair
shares, too, but for some; and so that the loads of a warp meet in few banks, see `schedules.banks`.

With b and c the ends, b of the pair of thread i stands at place i, and c at the place as many threads further, while
there are any left: the last pairs have b alone. Threads without a pair have the particles that are left.
"""

import random
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from balloon_warp.schedules.banks import BANKS
from balloon_warp.schedules.film_banks import HALF_WARP, QUARTER_WARP
from balloon_warp.schedules.memoize import memoized
from balloon_warp.schedules.pair_banks import EXCHANGED

B, C = 1, 2
"""of a pair's corners"""
STEPS = 10
"""of the search, for each pair"""
EXCHANGE_STEPS = 0.2
"""of them those that exchange a pair's quads"""


@memoized
def dealt_ends(corners: NDArray[np.int64], sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """The pair of each thread that has one, and whether its quads are exchanged, shape (n, 2); none if too few
    particles are ends, or too many pairs have none of their own.

    Args:
        corners: see `corners_of_pairs`.
        sizes: the numbers of particles and of threads.
    """
    from scipy.sparse import csr_array  # takes long to load
    from scipy.sparse.csgraph import maximum_bipartite_matching

    count, threads = sizes.tolist()
    none = np.empty((0, 2), dtype=np.int64)
    both_count = count - threads
    if not 0 < both_count <= len(corners) <= threads:
        return none
    pair = np.arange(len(corners)).repeat(2)
    graph = csr_array((np.ones(len(pair)), (pair, corners[:, [B, C]].ravel())), shape=(len(corners), count))
    own = maximum_bipartite_matching(graph, perm_type="column")
    if (own < 0).any():
        return none
    exchanged = (corners[:, C] == own).astype(np.int64)
    other = np.where(exchanged > 0, corners[:, B], corners[:, C])
    _, first = np.unique(other, return_index=True)
    has_both = np.sort(first[~np.isin(other[first], own)])[:both_count]
    if len(has_both) < both_count:
        return none
    order = np.concatenate([has_both, np.setdiff1d(np.arange(len(corners)), has_both)])
    return _searched(corners, np.stack([order, exchanged[order]], axis=1), sizes)


def seats(corners: NDArray[np.int64], sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """The particle at each place.

    Args:
        corners: of the pairs in the order of their threads.
        sizes: see `dealt_ends`.
    """
    count, threads = sizes.tolist()
    first, second = corners[:, B], corners[: count - threads, C]
    left = np.setdiff1d(np.arange(count), np.concatenate([first, second]))
    return np.concatenate([first, left, second])


def pairs_around(
    corners: NDArray[np.int64], edges: NDArray[np.int64], particles: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Two quads side by side with each of the particles as b, as `paired` gives them, shape (n, 4); -1 where none are.

    Args:
        corners: of quads, shape (m, 4).
        edges: see `shared_edges`.
    """
    first, second, of_first, of_second = edges.T
    there = np.stack([first, second, (of_first - 1) % 4, (of_second + 1) % 4], axis=1)
    back = np.stack([second, first, (of_second - 1) % 4, (of_first + 1) % 4], axis=1)
    begins = np.concatenate([corners[first, of_first], corners[second, of_second]])
    both = np.concatenate([there, back, np.full((1, 4), -1)])
    order = np.argsort(begins, kind="stable")
    found = np.searchsorted(begins[order], particles)
    edge = np.append(order, len(order))[found]
    return both[np.where(np.append(begins, -1)[edge] == particles, edge, len(order))]


def _searched(corners: NDArray[np.int64], dealt: NDArray[np.int64], sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """The same in another order: two pairs change threads, or the quads of one are exchanged, again and again, and that
    is kept if the squares of the banks' loads do not add up to more. Pairs with both ends stay before the others."""
    both_count = sizes[0] - sizes[1]
    six = np.where(dealt[:, 1:] > 0, corners[dealt[:, 0]][:, EXCHANGED], corners[dealt[:, 0]])
    search = _Search(six, seats(six, sizes), int(both_count), int(sizes[1]))
    choose = random.Random(0)
    for _ in range(STEPS * len(six)):
        if choose.random() < EXCHANGE_STEPS:
            search.exchange(choose.randrange(both_count))
        else:
            one, other = choose.randrange(both_count), choose.randrange(both_count)
            search.swap(one, other)
    order, exchanged = np.array(search.order), np.array(search.exchanged)
    return np.stack([dealt[order, 0], dealt[order, 1] ^ exchanged[order]], axis=1)


class _Search:
    """The pairs in threads, and how often the threads of a warp look in each bank.

    Args:
        six: corners of the pairs, in the order that they begin in.
        seats: the particle at each place then.
    """

    def __init__(self, six: NDArray[np.int64], seats: NDArray[np.int64], both_count: int, threads: int) -> None:
        self.order = list(range(len(six)))
        """the pair of each thread"""
        self.threads = list(range(len(six)))
        """the thread of each pair"""
        self.exchanged = [0] * len(six)
        self.loads = [0] * (len(EXCHANGED) * threads + 2 * threads + 2 * threads)
        self.halves, self.quarters = len(EXCHANGED) * threads, len(EXCHANGED) * threads + 2 * threads
        places = np.argsort(seats)[six]
        owner, end = places % threads, places // threads
        self.edges: list[list[tuple[int, int, int, int]]] = [[] for _ in six]
        for reader, corner in np.ndindex(*six.shape):
            pair = int(owner[reader, corner])
            if pair < len(six) and pair != reader and (corner not in (B, C)):
                edge = (reader, corner, pair, int(end[reader, corner]))
                self.edges[reader].append(edge)
                self.edges[pair].append(edge)
        for edge in {edge for edges in self.edges for edge in edges}:
            self._count(edge, 1)

    def _count(self, edge: tuple[int, int, int, int], by: int) -> int:
        """A corner that a pair reads the point of, and writes to, another's end. Returns by how much half the squares
        grow."""
        reader, corner, pair, end = edge
        here, there = self.threads[reader], self.threads[pair]
        corner = EXCHANGED[corner] if self.exchanged[reader] else corner
        end ^= self.exchanged[pair]
        point = (here // BANKS * len(EXCHANGED) + corner) * BANKS + there % BANKS
        half = self.halves + (there // HALF_WARP * 2 + end) * HALF_WARP + here % HALF_WARP
        quarter = self.quarters + (there // QUARTER_WARP * 2 + end) * QUARTER_WARP + here % QUARTER_WARP
        loads, more = self.loads, 0
        for bank in (point, half, quarter):
            more += loads[bank] if by > 0 else 1 - loads[bank]
            loads[bank] += by
        return more

    def _change(self, edges: list[tuple[int, int, int, int]], change: Callable[[], None]) -> None:
        """Keep a change if it is not for the worse."""
        more = sum(self._count(edge, -1) for edge in edges)
        change()
        more += sum(self._count(edge, 1) for edge in edges)
        if more > 0:
            for edge in edges:
                self._count(edge, -1)
            change()
            for edge in edges:
                self._count(edge, 1)

    def exchange(self, thread: int) -> None:
        """The quads of a thread's pair."""
        pair = self.order[thread]

        def change() -> None:
            self.exchanged[pair] ^= 1

        self._change(self.edges[pair], change)

    def swap(self, one: int, other: int) -> None:
        """The pairs of two threads."""
        first, second = self.order[one], self.order[other]

        def change() -> None:
            order, threads = self.order, self.threads
            order[one], order[other] = order[other], order[one]
            threads[order[one]], threads[order[other]] = one, other

        beside = [edge for edge in self.edges[second] if first not in (edge[0], edge[2])]
        if first != second:
            self._change(self.edges[first] + beside, change)

"""Quads two by two, so that both share an edge, and few pairs meet at a particle.

Each edge between two quads is taken or not: of each quad one, and at each particle as many as leave it few pairs.
Linear programs find them: what is whole in the best mix of edges is taken, then the most of what is left, until all is
whole.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from balloon_warp.schedules.memoize import memoized

if TYPE_CHECKING:
    from scipy.sparse import csr_array

WHOLE = 1e-6
"""how near to it counts"""
MOST_PROGRAMS = 20
"""one after the other"""
FEWEST = 3
"""pairs at a particle that are tried for: four quads, one of whose edges is shared"""


@memoized
def paired(corners: NDArray[np.int64], balloons: NDArray[np.int64]) -> NDArray[np.int64]:
    """The two quads of each pair, and by how many corners each is turned: the first until the edge from its second to
    its third corner is shared, the second until that is from its last to its first. Shape (n, 4), sorted; without pairs
    if there is none for some quad.

    Args:
        corners: of the quads, each in the same sense, shape (2 n, 4).
        balloons: which have no pair together.
    """
    none = np.empty((0, 4), dtype=np.int64)
    edges = shared_edges(corners, balloons)
    if len(corners) % 2 or not len(edges):
        return none
    particle_count, quads = corners.max() + 1, edges[:, :2]
    ends = np.stack([corners[quads[:, 0], edges[:, 2]], corners[quads[:, 0], (edges[:, 2] + 1) % 4]], axis=1)
    of_quads, at_particles = _incidence(quads, len(corners)), _incidence(ends, particle_count)
    counts = np.bincount(corners.ravel(), minlength=particle_count)
    for most in range(min(FEWEST, counts.max()), counts.max() + 1):
        taken = _taken(of_quads, np.ones(len(corners)), at_particles, counts - most)
        if taken is not None:
            first, second, of_first, of_second = edges[taken].T
            return np.stack([first, second, (of_first - 1) % 4, (of_second + 1) % 4], axis=1)
    return none


def shared_edges(corners: NDArray[np.int64], balloons: NDArray[np.int64]) -> NDArray[np.int64]:
    """Two quads of a balloon, and the corner of each that an edge begins at that both have, one there and one back;
    shape (n, 4). None of an edge of more than two."""
    quad, corner = np.divmod(np.arange(corners.size), 4)
    begin, end = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    order = np.lexsort((begin > end, high, low))
    key = low[order] * (corners.max() + 1) + high[order]
    same = np.concatenate([[False], key[1:] == key[:-1], [False]])
    here = np.flatnonzero(same[1:-1] & ~same[:-2] & ~same[2:])
    one, other = order[here], order[here + 1]
    there = (begin[one] == end[other]) & (quad[one] != quad[other]) & (balloons[quad[one]] == balloons[quad[other]])
    one, other = one[there], other[there]
    edges = np.stack([quad[one], quad[other], corner[one], corner[other]], axis=1)
    back = edges[:, 0] > edges[:, 1]
    edges[back] = edges[back][:, [1, 0, 3, 2]]
    return edges[np.lexsort(edges.T[::-1])]


def _incidence(ends: NDArray[np.int64], count: int) -> "csr_array":
    """1 where something is one of an edge's two."""
    from scipy.sparse import csr_array  # takes long to load

    edge = np.arange(len(ends))
    places = (ends.T.ravel(), np.concatenate([edge, edge]))
    return csr_array((np.ones(ends.size), places), shape=(count, len(ends)))


def _taken(
    of_quads: "csr_array", each: NDArray[np.float64], at_particles: "csr_array", least: NDArray[np.int64]
) -> NDArray[np.bool_] | None:
    """Which edges are; None if no way is found.

    Args:
        each: edges that are taken of each quad.
        least: that are taken at each particle.
    """
    from scipy.optimize import linprog  # takes long to load

    count = int(of_quads.sum()) // 2
    bounds = np.stack([np.zeros(count), np.ones(count)], axis=1)
    wishes = np.random.default_rng(0).random(count)  # without them many mixes are as good
    asking = least > 0
    for _ in range(MOST_PROGRAMS):
        found = linprog(
            wishes,
            A_ub=-at_particles[asking] if asking.any() else None,
            b_ub=-least[asking] if asking.any() else None,
            A_eq=of_quads,
            b_eq=each,
            bounds=bounds,
            method="highs-ds",
        )
        if found.x is None:
            return None
        parts = np.where(np.abs(found.x - np.round(found.x)) > WHOLE, found.x, 0.0)
        if not parts.any():
            return found.x > 0.5
        bounds[found.x > 1.0 - WHOLE, 0] = 1.0
        bounds[parts.argmax(), 0] = 1.0
    return None

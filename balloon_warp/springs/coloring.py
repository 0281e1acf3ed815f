"""Colors for springs, so that no two of one color meet at a particle."""

import numpy as np
from numpy.typing import NDArray


def color_springs(pairs: NDArray[np.integer], places: NDArray[np.floating]) -> NDArray[np.int64]:
    """Return each spring's color, shape (spring_count,): the lowest that no spring before it has at its ends.

    Springs are taken in the order of the places of their ends, so that the colors depend neither on the order that they
    are given in nor on how particles are numbered, unless particles coincide. At most 2 n - 1 colors come up where a
    particle has at most n springs.

    Args:
        pairs: the particles at the ends, shape (spring_count, 2), each pair once.
        places: of all particles, shape (particle_count, 3).
    """
    ranks = np.empty(len(places), dtype=np.int64)
    ranks[np.lexsort(places.T)] = np.arange(len(places))
    low, high = np.sort(ranks[pairs], axis=1).T
    colors = np.zeros(len(pairs), dtype=np.int64)
    taken = [0] * len(places)  # of each particle, a bit for each color
    for spring in np.lexsort([high, low]).tolist():
        p, q = int(low[spring]), int(high[spring])
        both = taken[p] | taken[q]
        free = ~both & (both + 1)
        colors[spring] = free.bit_length() - 1
        taken[p] |= free
        taken[q] |= free
    return colors

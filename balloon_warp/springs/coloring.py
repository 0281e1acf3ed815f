"""Colors for springs, so that no two of one color meet at a particle."""

import numpy as np
from numpy.typing import NDArray


def color_springs(pairs: NDArray[np.integer]) -> NDArray[np.int64]:
    """Each spring's color, shape (spring_count,): the lowest that no spring before it has at its ends.

    Springs are taken in the order of their ends, so that the colors do not depend on the order that they are given in.
    At most 2 n - 1 colors come up where a particle has at most n springs.

    Args:
        pairs: the particles at the ends, shape (spring_count, 2), each pair once.
    """
    low, high = np.sort(pairs, axis=1).T.astype(np.int64)
    colors = np.zeros(len(pairs), dtype=np.int64)
    taken = [0] * (int(pairs.max(initial=-1)) + 1)  # of each particle, a bit for each color
    for spring in np.lexsort([high, low]).tolist():
        p, q = int(low[spring]), int(high[spring])
        both = taken[p] | taken[q]
        free = ~both & (both + 1)
        colors[spring] = free.bit_length() - 1
        taken[p] |= free
        taken[q] |= free
    return colors

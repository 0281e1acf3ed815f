"""Connected components of a graph, in NumPy alone."""

import numpy as np
from numpy.typing import NDArray


def component_labels(count: int, first: NDArray[np.int64], second: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the lowest node that each node is connected with, shape (count,).

    Args:
        count: nodes, numbered from 0.
        first: one end of each edge, shape (edge_count,).
        second: the other end, shape (edge_count,).
    """
    labels = np.arange(count)
    while True:
        low = np.minimum(labels[first], labels[second])
        high = np.maximum(labels[first], labels[second])
        if (low == high).all():
            return labels
        # Hook each root below its lowest neighbor, then let every node point at its root.
        np.minimum.at(labels, high, low)
        while (labels != labels[labels]).any():
            labels = labels[labels]

"""Sample points in a pixel, and on a light.

They are the same every time, so that pictures are.
"""

import numpy as np
from numpy.typing import NDArray

TILE = 4
"""Side of a tile whose pixels share one well-spread set of samples [pixels]"""


def spread_points(count: int) -> NDArray[np.float64]:
    """Return Well-spread points in the unit square, shape (count, 2): a lattice sheared by the golden ratio."""
    numbers = np.arange(count)
    golden = 0.5 * (np.sqrt(5.0) - 1.0)
    return np.stack([(numbers + 0.5) / count, np.modf(0.5 + numbers * golden)[0]], axis=1)


def disc_points(samples: int) -> NDArray[np.float32]:
    """Return the points in the unit disc for each sample of each pixel of a tile, shape (samples, TILE * TILE, 2).

    Concentric map of Shirley and Chiu (1997), which keeps neighbors neighbors.
    """
    a, b = (2.0 * spread_points(samples * TILE * TILE) - 1.0).T
    wide = np.abs(a) > np.abs(b)
    radius = np.where(wide, a, b)
    ratio = np.divide(np.where(wide, b, a), radius, out=np.zeros_like(a), where=radius != 0.0)
    angle = np.where(wide, np.pi / 4.0 * ratio, np.pi / 2.0 - np.pi / 4.0 * ratio)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return points.reshape(samples, TILE * TILE, 2).astype(np.float32)

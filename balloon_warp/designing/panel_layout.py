"""Layout of panels on the sheet: each upright, side by side in rows."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.designing.panels import Panels

Values = NDArray[np.float64]
APART = 0.03
"""Distance between panels, with room for the seam allowance [m]"""
WIDE = 1.5
"""Approximate width of the sheet over its height"""


def laid_out(panels: Panels, flat: Values) -> Values:
    """Turn and move panels so that none lies on another, shape (m, 2)."""
    places = flat.copy()
    own = [np.flatnonzero(panels.of_vertices == panel) for panel in range(panels.count)]
    for vertices in own:
        places[vertices] = _upright(flat[vertices])
    sizes = np.array([places[vertices].max(axis=0) for vertices in own]) + APART
    width = max(np.sqrt(WIDE * sizes.prod(axis=1).sum()), sizes[:, 0].max())
    x, y, high = 0.0, 0.0, 0.0
    for panel in np.argsort(-sizes[:, 1], kind="stable").tolist():
        if x > 0.0 and x + sizes[panel, 0] > 1.001 * width:
            x, y, high = 0.0, y - high, 0.0
        places[own[panel]] += [x, y - sizes[panel, 1]]
        x, high = x + sizes[panel, 0], max(high, float(sizes[panel, 1]))
    return places


def _upright(flat: Values) -> Values:
    """Return a panel as high as it is long, from 0 on."""
    centered = flat - flat.mean(axis=0)
    long = np.linalg.svd(centered, full_matrices=False)[2][0]
    turn = np.array([[long[1], long[0]], [-long[0], long[1]]])  # the long way becomes up
    turned = centered @ turn
    return turned - turned.min(axis=0)

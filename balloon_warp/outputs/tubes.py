"""Lines as tubes of quads, for files that have polygons alone."""

import numpy as np
from numpy.typing import NDArray

SIDES = 6
"""Number of sides of a line's cross section"""


def tube_topology(lengths: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the quads around curves, as `tube_points` places them: corners of each face, and of all."""
    goes_on = np.ones(int(lengths.sum()), bool)
    goes_on[np.cumsum(lengths)[lengths > 0] - 1] = False
    begins = np.flatnonzero(goes_on)
    side = np.arange(SIDES)
    after = (side + 1) % SIDES
    here = SIDES * begins[:, None]
    quads = np.stack([here + side, here + after, here + SIDES + after, here + SIDES + side], axis=-1).reshape(-1, 4)
    return np.full(len(quads), 4, np.int32), quads.ravel().astype(np.int32)


def tube_points(centers: NDArray[np.float64], lengths: NDArray[np.int32], radius: float) -> NDArray[np.float64]:
    """Return the points around curves: `SIDES` about each point, shape (SIDES * len(centers), 3).

    The cross section is carried along each curve with as little turning as can be, so that nothing is twisted.
    """
    rings = np.empty((len(centers), SIDES, 3))
    turn = 2.0 * np.pi * np.arange(SIDES)[:, None] / SIDES
    begin = 0
    for length in lengths.tolist():
        curve = centers[begin : begin + length]
        steps = np.diff(curve, axis=0, prepend=2.0 * curve[:1] - curve[1:2] if length > 1 else curve[:1] - 1.0)
        across = np.eye(3)[np.abs(steps[0]).argmin()] if length else np.zeros(3)
        for place, step in enumerate(steps):
            size = np.linalg.norm(step)
            direction = step / size if size > 0.0 else np.zeros(3)
            across = across - (across @ direction) * direction
            across = across / max(float(np.linalg.norm(across)), 1e-12)
            ring = np.cos(turn) * across + np.sin(turn) * np.cross(direction, across)
            rings[begin + place] = curve[place] + radius * ring
        begin += length
    return rings.reshape(-1, 3)

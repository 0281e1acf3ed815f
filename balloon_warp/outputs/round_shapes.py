"""Spheres, capsules and lines as quads, for files that have polygons alone."""

import numpy as np
from numpy.typing import NDArray

AROUND, RINGS = 32, 16
"""Number of quads around a sphere, even, and from pole to pole; at the poles two triangles are one quad"""
SIDES = 6
"""Number of sides of a line's cross section"""

Faces = tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int32]]
"""Points, corners of each face, corners of all faces"""


def sphere_mesh(radius: float) -> Faces:
    """Return a sphere about the origin, its poles along Y."""
    return capsule_mesh(radius, 0.0, axis=1)


def capsule_mesh(radius: float, height: float, axis: int) -> Faces:
    """Return a capsule about the origin.

    Args:
        radius: of its ends.
        height: between the centers of its ends; 0 for a sphere.
        axis: 0, 1 or 2 for X, Y or Z.
    """
    polar = np.linspace(0.0, np.pi, RINGS + 1)[1:-1]
    if height > 0.0:  # the equator twice, to be drawn apart
        polar = np.sort(np.append(polar, 0.5 * np.pi))
    middle = len(polar) // 2
    shift = np.where(np.arange(len(polar)) < middle, 0.5, -0.5) * height
    turn = 2.0 * np.pi * np.arange(AROUND) / AROUND
    # along, and two across: a right-handed frame
    along = np.repeat(radius * np.cos(polar) + shift, AROUND)
    out = radius * np.sin(polar)[:, None]
    rings = np.stack([along, (out * np.cos(turn)).ravel(), (out * np.sin(turn)).ravel()], axis=1)
    end = radius + 0.5 * height
    points = np.concatenate([rings, [[end, 0.0, 0.0], [-end, 0.0, 0.0]]])
    here = np.arange(AROUND)
    after = (here + 1) % AROUND
    starts = AROUND * np.arange(len(polar) - 1)[:, None]
    quads = np.stack([starts + here, starts + AROUND + here, starts + AROUND + after, starts + after], axis=-1)
    first, last = len(rings), len(rings) + 1
    bottom = AROUND * (len(polar) - 1)
    two = here[::2]
    pole = np.ones_like(two)
    caps = [
        np.stack([first * pole, two, two + 1, (two + 2) % AROUND], axis=1),
        np.stack([last * pole, bottom + (two + 2) % AROUND, bottom + two + 1, bottom + two], axis=1),
    ]
    indices = np.concatenate([quads.reshape(-1, 4), *caps]).astype(np.int32)
    return np.roll(points, axis, axis=1), np.full(len(indices), 4, np.int32), indices.ravel()


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

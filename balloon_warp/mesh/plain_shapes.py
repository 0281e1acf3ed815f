"""Boxes, rectangles and surfaces of revolution as quads, about the origin."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

AROUND = 32
"""Number of quads around an axis, even: at a pole two triangles are one quad"""
RINGS = 8
"""Number of quads from a pole of a sphere to its equator"""
MOST_RINGS = 256
"""Largest number of rings along a straight line"""


class Faces(NamedTuple):
    """A surface, without a name or a unit."""

    points: NDArray[np.float64]
    """Points, shape (n, 3)"""
    counts: NDArray[np.int32]
    """Corners of each face"""
    indices: NDArray[np.int32]
    """Point of each corner, counter-clockwise from outside"""


def box_faces(size: float) -> Faces:
    """Return a cube of six faces."""
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Faces(size * corners, np.full(6, 4, np.int32), np.array(sides, np.int32).ravel())


def rectangle_faces(width: float, length: float, axis: int) -> Faces:
    """Return a rectangle of one face that looks along an axis, as USD's Plane lies."""
    across, along = np.eye(3)[[2, 0, 0][axis]], np.eye(3)[[1, 2, 1][axis]]
    corners = 0.5 * np.array([-1, 1, 1, -1])[:, None] * width * across
    corners = corners + 0.5 * np.array([-1, -1, 1, 1])[:, None] * length * along
    turned = np.cross(across, along)[axis] < 0.0
    return Faces(corners, np.full(1, 4, np.int32), np.array([3, 2, 1, 0] if turned else [0, 1, 2, 3], np.int32))


def capsule_faces(radii: tuple[float, float], height: float, axis: int) -> Faces:
    """Return a capsule: round ends of radii, first of the upper one, whose centers are a height apart."""
    polar = np.linspace(0.0, 0.5 * np.pi, RINGS + 1)
    upper = np.stack([radii[0] * np.cos(polar) + 0.5 * height, radii[0] * np.sin(polar)], axis=1)
    lower = np.stack([-radii[1] * np.cos(polar) - 0.5 * height, radii[1] * np.sin(polar)], axis=1)[::-1]
    return _revolved(np.concatenate([upper, _between(upper[-1], lower[0]), lower[height == 0.0 :]]), axis)


def cylinder_faces(radii: tuple[float, float], height: float, axis: int) -> Faces:
    """Return a closed cylinder, or a cone where the upper or the lower of its radii is 0."""
    profile = 0.5 * height * np.array([1.0, 1.0, -1.0, -1.0])
    corners = np.stack([profile, [0.0, *radii, 0.0]], axis=1)
    distinct = corners[np.append(True, np.any(np.diff(corners, axis=0) != 0.0, axis=1))]
    pieces = [np.vstack([begin, _between(begin, end)]) for begin, end in pairwise(distinct)]
    return _revolved(np.concatenate([*pieces, distinct[-1:]]), axis)


def _between(begin: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the places between two corners of a profile that make its quads about as long as wide."""
    wide = 2.0 * np.pi * max(begin[1], end[1]) / AROUND
    count = int(np.clip(np.ceil(np.linalg.norm(end - begin) / wide), 1, MOST_RINGS)) if wide > 0.0 else 1
    return np.linspace(begin, end, count + 1)[1:-1]


def _revolved(profile: NDArray[np.float64], axis: int) -> Faces:
    """Return the surface that a profile goes through around an axis.

    Args:
        profile: places along the axis and distances from it, from the upper pole to the lower, shape (n, 2).
        axis: 0, 1 or 2 for X, Y or Z.
    """
    turn = 2.0 * np.pi * np.arange(AROUND) / AROUND
    along, out = np.repeat(profile[1:-1, 0], AROUND), profile[1:-1, 1:]
    # along, and two across: a right-handed frame
    rings = np.stack([along, (out * np.cos(turn)).ravel(), (out * np.sin(turn)).ravel()], axis=1)
    points = np.concatenate([rings, [[profile[0, 0], 0.0, 0.0], [profile[-1, 0], 0.0, 0.0]]])
    here = np.arange(AROUND)
    after = (here + 1) % AROUND
    starts = AROUND * np.arange(len(profile) - 3)[:, None]
    quads = np.stack([starts + here, starts + AROUND + here, starts + AROUND + after, starts + after], axis=-1)
    bottom, two = len(rings) - AROUND, here[::2]
    pole = np.ones_like(two)
    caps = [
        np.stack([len(rings) * pole, two, two + 1, (two + 2) % AROUND], axis=1),
        np.stack([(len(rings) + 1) * pole, bottom + (two + 2) % AROUND, bottom + two + 1, bottom + two], axis=1),
    ]
    indices = np.concatenate([quads.reshape(-1, 4), *caps]).astype(np.int32)
    return Faces(np.roll(points, axis, axis=1), np.full(len(indices), 4, np.int32), indices.ravel())

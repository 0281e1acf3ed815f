"""Shapes that are drawn, not simulated: lines as tubes, round edges of boxes, knots."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import corner_faces, face_vector_areas, total_area
from balloon_warp.scene import Balloon, String

OF_LARGEST, OF_LEAST = 0.02, 0.25
"""Largest radius of the edges over the largest and over the least side"""
STEPS = np.radians([15.0, 30.0, 45.0])
"""Angles along an edge's quarter circle, from either side to its middle"""
RIM = 0.3
"""Width of the flat strip beside the edges, in radii: normals that a renderer finds bend there alone"""


def beveled_box(half: NDArray[np.float64]) -> tuple[PolygonMesh, NDArray[np.float64]]:
    """Return a box about the origin, and the unit normal of each of its points, shape (vertex_count, 3).

    Args:
        half: half its sides, shape (3,); the flat parts of its faces lie there exactly.
    """
    radius = 2.0 * min(OF_LARGEST * float(half.max()), OF_LEAST * float(half.min()))
    inner = half - radius
    edge = np.concatenate([[-RIM, 0.0], np.tan(STEPS)]) * radius
    lines = [np.concatenate([-(length + edge)[::-1], length + edge]) for length in inner]
    count = 2 * len(edge)
    corner = count * np.arange(count - 1)[:, None] + np.arange(count - 1)
    quad = np.stack([corner, corner + count, corner + count + 1, corner + 1], axis=-1).reshape(-1, 4)
    points, quads = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            u, v = np.meshgrid(lines[(axis + 1) % 3], lines[(axis + 2) % 3], indexing="ij")
            side = np.empty((count * count, 3))
            side[:, axis], side[:, (axis + 1) % 3], side[:, (axis + 2) % 3] = sign * half[axis], u.ravel(), v.ravel()
            quads.append(len(points) * count * count + (quad if sign > 0.0 else quad[:, ::-1]))
            points.append(side)
    cube = np.concatenate(points)
    core = np.clip(cube, -inner, inner)
    normals = (cube - core) / np.linalg.norm(cube - core, axis=1, keepdims=True)
    _, first, same = np.unique(np.round(cube / half, 9), axis=0, return_index=True, return_inverse=True)
    corners = same.ravel()[np.concatenate(quads)].astype(np.int32)
    box = PolygonMesh((core + radius * normals)[first], np.full(len(corners), 4, np.int32), corners.ravel())
    return box, normals[first]


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


PROFILE = np.array(
    [
        *((-0.035, 0.028), (0.000, 0.026), (0.015, 0.018)),  # the neck, from under the balloon's surface
        *((0.025, 0.024), (0.040, 0.033), (0.055, 0.024)),  # the knot
        *((0.063, 0.016), (0.078, 0.024), (0.092, 0.038), (0.097, 0.036)),  # the lip, and its rolled rim
        *((0.084, 0.016), (0.076, 0.000)),  # the funnel in the lip, where the string comes out
    ]
)
"""Distance outward of each ring, and its radius, in `knot_size`"""
AROUND = 12
"""Number of points of a ring"""


def has_knot(string: String, balloon: Balloon) -> bool:
    """Return whether a knot shows where a string is tied; foil is not knotted."""
    return string.knot and balloon.looks_like != "foil"


class Knot:
    """Knot of one string.

    Args:
        mesh: Mesh of the balloon at the start.
        particle: Particle that the string holds, by its number in the mesh.
    """

    def __init__(self, mesh: PolygonMesh, particle: int):
        self.particle = particle
        faces = corner_faces(mesh)
        about = np.isin(faces, faces[mesh.face_vertex_indices == particle])
        self._used, corners = np.unique(mesh.face_vertex_indices[about], return_inverse=True)
        counts = mesh.face_vertex_counts[np.unique(faces[about])]
        self._around = PolygonMesh(mesh.points[self._used], counts, corners.reshape(-1).astype(np.int32))

    def pose(self, points: NDArray[np.floating], curve: NDArray[np.floating], up: ArrayLike) -> NDArray[np.float64]:
        """Return the pose of the knot.

        Args:
            points: Points of the balloon [m], shape (particle_count, 3).
            curve: Curve of the string, from its anchor to the particle [m], shape (n, 3).
            up: Unit vector: without rotation the knot hangs down.

        Returns:
            Position [m], and orientation as a quaternion (x, y, z, w), shape (7,).
        """
        place = points[self.particle].astype(np.float64)
        down = -np.asarray(up, float)
        return np.concatenate([place, turn_between(down, self._direction(points, curve, down))])

    def _direction(
        self, points: NDArray[np.floating], curve: NDArray[np.floating], otherwise: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the direction along the string, bent away from the balloon.

        It is never nearer to the balloon's surface than 45 degrees.
        """
        ends = curve.astype(np.float64)
        along = ends[-2] - ends[-1]
        normal = face_vector_areas(replace(self._around, points=points[self._used].astype(np.float64))).sum(axis=0)
        normal, along = (_unit(vector) for vector in (normal, along))
        if not normal.any():
            return along if along.any() else otherwise
        return _unit(along + (1.0 - along @ normal) * normal)


def knot_size(mesh: PolygonMesh) -> float:
    """Return the diameter of a sphere of a balloon's area at the start [m]: the unit of `PROFILE`."""
    return float(np.sqrt(total_area(mesh) / np.pi))


def knot_mesh(size: float, up: ArrayLike) -> PolygonMesh:
    """Return a knot that hangs down from the origin, in quads whose outside is outward.

    Args:
        size: as `knot_size` has it.
        up: unit vector, along an axis.
    """
    up = np.asarray(up, float)
    turn = 2.0 * np.pi * np.arange(AROUND) / AROUND
    out, radius = size * PROFILE[:-1].T
    side = np.roll(up, 1)
    other = np.cross(side, up)
    ring = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other
    points = (radius[:, None, None] * ring - out[:, None, None] * up).reshape(-1, 3)
    points = np.concatenate([points, [-size * PROFILE[-1, 0] * up]])
    here = np.arange(AROUND)
    after = (here + 1) % AROUND
    starts = AROUND * np.arange(len(out) - 1)[:, None]
    quads = np.stack([starts + here, starts + after, starts + AROUND + after, starts + AROUND + here], axis=-1)
    bottom = AROUND * (len(out) - 1)
    even = here[::2]
    closing = [bottom + even, bottom + even + 1, bottom + (even + 2) % AROUND, np.full_like(even, len(points) - 1)]
    indices = np.concatenate([quads.reshape(-1, 4), np.stack(closing, axis=1)]).astype(np.int32)
    return PolygonMesh(points, np.full(len(indices), 4, np.int32), indices.ravel())


def turn_between(one: NDArray[np.floating], other: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the quaternion (x, y, z, w) of the shortest turn from one unit vector to another."""
    half = 1.0 + float(one @ other)
    if half < 1e-9:  # half a turn, about any axis across
        across = np.cross(one, np.eye(3)[np.abs(one).argmin()])
        return np.append(_unit(across), 0.0)
    quaternion = np.append(np.cross(one, other), half)
    return quaternion / np.linalg.norm(quaternion)


def _unit(vector: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return a unit vector; a vector of no length stays as it is."""
    return vector.astype(np.float64) / max(float(np.linalg.norm(vector)), 1e-300)

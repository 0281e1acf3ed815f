"""The neck and the knot of a balloon where a string is tied: drawn, not simulated."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.corners import corner_faces
from balloon_warp.mesh.geometry import face_vector_areas, total_area
from balloon_warp.scene import Balloon, String

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

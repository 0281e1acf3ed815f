"""Spheres that may pass through a balloon.

Where only particles touch spheres, a small sphere passes between them, and a fast one may jump over them.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.corners import corner_faces, next_corners
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Scene

MOST_STRETCH = 2.0
"""Stretch of faces that is allowed for: their size is known at rest, and not when inflated"""


def warnings_of(
    scene: Scene, shapes: Sequence[BalloonShape], radii: NDArray[np.floating], step_seconds: float
) -> list[str]:
    """Return warnings of the meshes and of `passing_spheres`, which are given before a run."""
    of_shapes = [warning for shape in shapes for warning in shape.warnings]
    return of_shapes + passing_spheres(scene, shapes, radii, step_seconds)


def passing_spheres(
    scene: Scene, shapes: Sequence[BalloonShape], radii: NDArray[np.floating], step_seconds: float
) -> list[str]:
    """Return a sentence for each sphere that may pass through the faces of a balloon, or jump over its particles.

    Args:
        radii: of the spheres at the start [m], shape (W, sphere_count); 0 before it appears.
        step_seconds: a substep [s].
    """
    if not scene.sphere or (scene.touch and scene.touch.spheres):
        return []
    sentences = []
    widest = max(shapes, key=lambda shape: widest_opening(shape.mesh))
    opening = widest_opening(widest.mesh)
    for number, sphere in enumerate(scene.sphere):
        there = radii[:, number][radii[:, number] > 0.0]
        radius = float(there.min()) if len(there) else sphere.radius
        if scene.touches_spheres and radius < held_within(scene) * opening:
            continue  # it meets them
        if radius < MOST_STRETCH * opening:
            sentences.append(_fits_through(number, radius, opening, widest))
        way = step_seconds * _highest_speed(scene, number, shapes)
        if scene.contact == "penalty" and way > radius:
            sentences.append(
                f"sphere {number}: may move {way:.2g} m in a substep, more than its radius of {radius:.2g} m, and so "
                'tunnel through a balloon; more substeps or contact = "impulse" help'
            )
    return sentences


def held_within(scene: Scene) -> float:
    """Return the multiple of faces' openings up to which spheres touch faces, not only particles.

    Openings are those at rest, or where the scene asks for it, stretched.
    """
    return 1.0 if scene.faces == "auto" and not scene.touch else MOST_STRETCH


def _fits_through(number: int, radius: float, opening: float, shape: BalloonShape) -> str:
    stretch = radius / opening
    where = "even at rest" if stretch <= 1.0 else f"at a stretch of {stretch:.2g}"
    return (
        f"sphere {number}: its radius of {radius:.2g} m fits through faces of {shape.name}, {where}, since only "
        f"particles touch it and the longest edge is {_longest_edge(shape.mesh):.2g} m at rest; faces = true, a larger "
        "sphere or a finer mesh helps"
    )


def widest_opening(mesh: PolygonMesh) -> float:
    """Return the radius of the largest sphere that passes between the corners of a face, through its center [m].

    It is 0.58 of the edge of a triangle, 0.71 of a square's.
    """
    faces, corners = corner_faces(mesh), mesh.points[mesh.face_vertex_indices]
    sums = np.stack([np.bincount(faces, corners[:, axis], mesh.face_count) for axis in range(3)], axis=1)
    distances = np.linalg.norm(corners - (sums / mesh.face_vertex_counts[:, None])[faces], axis=1)
    nearest = np.full(mesh.face_count, np.inf)
    np.minimum.at(nearest, faces, distances)
    return float(nearest.max())


def _longest_edge(mesh: PolygonMesh) -> float:
    corners = mesh.points[mesh.face_vertex_indices]
    return float(np.linalg.norm(corners[next_corners(mesh)] - corners, axis=1).max())


def _highest_speed(scene: Scene, number: int, shapes: Sequence[BalloonShape]) -> float:
    """Return the speed of a sphere after a fall from its start to the height of the lowest particle [m/s]."""
    sphere, up = scene.sphere[number], np.array(scene.up)
    lowest = min(float((shape.mesh.points @ up).min()) for shape in shapes)
    fall = max(float(np.dot(sphere.position, up)) - lowest, 0.0)
    return float(np.sqrt(np.dot(sphere.velocity, sphere.velocity) + 2.0 * max(scene.gravity, 0.0) * fall))

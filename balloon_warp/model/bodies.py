"""Free rigid bodies on the host: their shapes about their centers of mass, masses, inertia and rotations."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.placement import rotation_matrix
from balloon_warp.model.body_samples import Samples, sample
from balloon_warp.model.obstacles import ObstacleShape, shape_obstacle
from balloon_warp.model.parameters import Parameters
from balloon_warp.scene import Body, Scene

TOUCHES_OF_SAMPLE, TOUCHES_OF_BODY = 2, 64
"""Capacities of the contact list, for each sample and for each body"""
PLAIN_MASS = 1.0
"""Mass of a body without mass and density [kg]"""


@dataclass(frozen=True)
class BodyShape:
    """A body about its center of mass, not turned."""

    solid: ObstacleShape
    center: NDArray[np.float64]
    """Center of mass, from the body's own origin [m], shape (3,)"""
    inertia: NDArray[np.float64]
    """Inertia tensor of 1 kg about the center of mass [m^2], shape (3, 3)"""
    volume: float
    """Volume of the body's material [m^3]"""
    samples: Samples
    """Sample points that are held out of other solids"""


def shape_body(number: int, body: Body, scene: Scene) -> BodyShape:
    """Read a body's mesh and weigh it.

    Raises:
        InputError: the mesh cannot be read, has no size, or is open and without a thickness.
    """
    solid = shape_obstacle(number, body, scene)
    center, up = np.zeros(3), np.array(scene.up)
    if solid.mesh is None:
        volume, second = _moments_of_box(solid.size) if solid.kind == "box" else _moments_of_capsule(solid.size, up)
    else:
        if not solid.closed and not body.thickness:
            raise InputError(
                f"body.{number}.thickness: is missing, and {solid.mesh.name} is not closed; expected half the sheet's "
                "thickness, or a closed mesh"
            )
        corners = solid.mesh.points[solid.triangles]
        volume, center, second = _moments_of_solid(corners) if solid.closed else _moments_of_sheet(corners)
        if volume <= 0.0:
            raise InputError(f"body.{number}.mesh: {solid.mesh.name} encloses no volume; expected a solid mesh")
        if not solid.closed:
            volume *= 2.0 * solid.thickness
        mesh = replace(solid.mesh, points=solid.mesh.points - center)
        reach = float(np.linalg.norm(mesh.points[mesh.face_vertex_indices], axis=1).max()) + solid.thickness
        solid = replace(solid, mesh=mesh, reach=reach)
    return BodyShape(solid, center, np.trace(second) * np.eye(3) - second, volume, sample(solid, up))


def most_touches(shapes: Sequence[BodyShape]) -> int:
    """Return the largest number of contacts of bodies in a step, over all things; no further ones are resolved."""
    return sum(TOUCHES_OF_SAMPLE * len(shape.samples.points) + TOUCHES_OF_BODY for shape in shapes)


def settle_bodies(scene: Scene, shapes: Sequence[BodyShape], parameters: Parameters) -> Parameters:
    """Return the masses of bodies with a density, or with neither density nor mass [kg], shape (W, body_count)."""
    said = parameters["body_mass"]
    settled = [
        PLAIN_MASS if body.density is None else body.density * shape.volume
        for body, shape in zip(scene.body, shapes, strict=True)
    ]
    return {"body_mass": np.where(np.isnan(said), np.array(settled).reshape(1, -1), said)}


def initial_turns(scene: Scene) -> NDArray[np.float64]:
    """Return the initial orientations of bodies as quaternions (x, y, z, w), shape (body_count, 4)."""
    if not scene.body:
        return np.zeros((0, 4))
    from scipy.spatial.transform import Rotation  # takes long to load

    return np.array([Rotation.from_matrix(rotation_matrix(body.rotation)).as_quat() for body in scene.body])


def initial_centers(scene: Scene, shapes: Sequence[BodyShape], positions: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return initial centers of mass [m], shape (W, body_count, 3), from the initial origins, of the same shape."""
    arms = [rotation_matrix(body.rotation) @ shape.center for body, shape in zip(scene.body, shapes, strict=True)]
    return positions + np.array(arms).reshape(-1, 3)


def initial_poses(scene: Scene, shapes: Sequence[BodyShape], positions: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return initial centers of mass [m] and orientations, as `Frame.body_poses`, shape (W, body_count, 7)."""
    centers = initial_centers(scene, shapes, positions)
    turns = np.broadcast_to(initial_turns(scene), (*centers.shape[:-1], 4))
    return np.concatenate([centers, turns], axis=-1)


def most_ease(shape: BodyShape, arms: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the largest speed that an impulse of 1 N s gives points of a body of 1 kg [m/s], of all directions.

    Args:
        arms: of the points from the center of mass, in the body's axes [m], shape (..., 3).
    """
    across = np.cross(np.eye(3), arms[..., None, :])  # row i is e_i x r
    turning = across @ np.linalg.solve(shape.inertia, across.swapaxes(-1, -2))
    return np.asarray(1.0 + np.linalg.eigvalsh(turning)[..., -1], dtype=np.float64)


def _moments_of_box(half: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Return the volume, and the mean of x x^T, shape (3, 3)."""
    return float(8.0 * half.prod()), np.diag(half**2 / 3.0)


def _moments_of_capsule(size: NDArray[np.float64], up: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Return a cylinder and two halves of a ball, along the up axis."""
    radius, half = float(size[0]), float(size[1])
    tube, ball = 2.0 * np.pi * radius**2 * half, 4.0 / 3.0 * np.pi * radius**3
    across = (tube * radius**2 / 4.0 + ball * radius**2 / 5.0) / (tube + ball)
    cap = radius**2 / 5.0 + half**2 + 0.75 * half * radius
    along = (tube * half**2 / 3.0 + ball * cap) / (tube + ball)
    return tube + ball, across * np.eye(3) + (along - across) * np.outer(up, up)


def _moments_of_solid(corners: NDArray[np.float64]) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return volume, center of mass, and the mean of x x^T about it, of tetrahedra over outward triangles."""
    origin = corners.mean(axis=(0, 1))
    arms = corners - origin
    volumes = np.einsum("ij,ij->i", arms[:, 0], np.cross(arms[:, 1], arms[:, 2])) / 6.0
    return _moments(arms, volumes, origin, 4)


def _moments_of_sheet(corners: NDArray[np.float64]) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return the area, center of mass, and the mean of x x^T about it, of triangles."""
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return _moments(corners, areas, np.zeros(3), 3)


def _moments(
    corners: NDArray[np.float64], sizes: NDArray[np.float64], origin: NDArray[np.float64], corner_count: int
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return the moments of simplices with a number of corners, of which those not given are at the origin."""
    whole, sums = float(sizes.sum()), corners.sum(axis=1)
    if whole <= 0.0:
        return whole, origin, np.zeros((3, 3))
    middle = sizes @ sums / (corner_count * whole)
    products = np.einsum("nki,nkj->nij", corners, corners) + np.einsum("ni,nj->nij", sums, sums)
    second = np.einsum("n,nij->ij", sizes, products) / (corner_count * (corner_count + 1) * whole)
    return whole, origin + middle, second - np.outer(middle, middle)

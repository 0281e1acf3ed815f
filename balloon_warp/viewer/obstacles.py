"""Obstacles and free bodies in the page: a mesh for each, moved to where it is."""

from typing import Any

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from balloon_warp.mesh.geometry import triangulate
from balloon_warp.model.obstacles import ObstacleShape
from balloon_warp.outputs.render.framing import BACKDROP
from balloon_warp.outputs.usd.planes import SIZES
from balloon_warp.viewer import colors
from balloon_warp.viewer.picture import Picture
from balloon_warp.viewer.rays import hit_distance

Surface = tuple[NDArray[np.float64], NDArray[np.integer[Any]]]
"""Points [m], shape (n, 3), and triangles, shape (m, 3)"""
ROUND = 32
"""Number of corners of a circle"""
ROOT = "/obstacles"


class ObstacleLayer:
    """Obstacles and bodies of a scene.

    Args:
        server: Server of the page.
        picture: First picture of the scene.
        center: Center of the balloons at the start [m], shape (3,).
        size: Size of the balloons [m].
    """

    def __init__(self, server: viser.ViserServer, picture: Picture, center: NDArray[np.floating], size: float):
        server.scene.add_frame(ROOT, show_axes=False)
        self._meshes, self._surfaces, seen = [], [], [np.zeros((0, 3))]
        model = picture.model
        shapes = [*model.obstacles, *(body.solid for body in model.bodies)]
        own_colors = [colors.obstacle_color(picture.scene, n, shape.mesh) for n, shape in enumerate(model.obstacles)]
        own_colors += [colors.body_color(picture.scene, n, body.solid.mesh) for n, body in enumerate(model.bodies)]
        for number, (shape, pose, color) in enumerate(zip(shapes, _poses(picture), own_colors, strict=True)):
            below = Rotation.from_quat(pose[3:]).inv().apply(center - pose[:3])
            points, triangles = surface_of(shape, picture.scene.up, below, SIZES * size)
            mesh = server.scene.add_mesh_simple(
                f"{ROOT}/{number}", points, triangles, color=color, flat_shading=shape.kind != "capsule", side="double"
            )
            self._meshes.append(mesh)
            self._surfaces.append((points, triangles))
            if np.ptp(points, axis=0).max() <= BACKDROP * size:
                seen.append(Rotation.from_quat(pose[3:]).apply(points) + pose[:3])
        self.seen = np.concatenate(seen)
        """Points of those that are to be seen as a whole, at their first place [m], shape (n, 3)"""
        self._shown: list[NDArray[np.float64] | None] = [None] * len(self._meshes)

    def draw(self, picture: Picture) -> None:
        """Move obstacles and bodies to their poses; the page is told only of changes."""
        for number, (mesh, pose) in enumerate(zip(self._meshes, _poses(picture), strict=True)):
            shown = self._shown[number]
            if shown is None or not np.array_equal(shown, pose):
                mesh.position, mesh.wxyz = tuple(pose[:3].tolist()), tuple(pose[[6, 3, 4, 5]].tolist())
                self._shown[number] = pose

    def hit_distance(self, origin: NDArray[np.floating], direction: NDArray[np.floating]) -> float | None:
        """Return the distance along a ray to the nearest of them, where they were drawn last, or None."""
        hits = []
        for (points, triangles), pose in zip(self._surfaces, self._shown, strict=True):
            if pose is not None:
                back = Rotation.from_quat(pose[3:]).inv()
                hits.append(hit_distance(back.apply(origin - pose[:3]), back.apply(direction), points, triangles))
        return min((hit for hit in hits if hit is not None), default=None)


def _poses(picture: Picture) -> NDArray[np.float64]:
    """Return the poses of all that have one, shape (n, 7)."""
    return np.concatenate([picture.frame.obstacle_poses, picture.frame.body_poses.astype(np.float64)])


def surface_of(
    shape: ObstacleShape, up: tuple[float, float, float], below: NDArray[np.floating], half: float
) -> Surface:
    """Return the surface that is drawn of a shape, about its own origin.

    Args:
        up: Unit vector of the up axis.
        below: Point over the middle of the drawn part of a plane [m], shape (3,).
        half: Half its side [m].
    """
    if shape.mesh is not None:
        return shape.mesh.points, triangulate(shape.mesh)[0]
    if shape.kind == "box":
        box = trimesh.creation.box(2.0 * shape.size)
        return np.asarray(box.vertices), np.asarray(box.faces)
    to_up = Rotation.align_vectors([up], [(0.0, 0.0, 1.0)])[0]
    if shape.kind == "capsule":
        capsule = trimesh.creation.capsule(2.0 * shape.size[1], shape.size[0], count=[ROUND, ROUND])
        points = np.asarray(capsule.vertices) - capsule.bounds.mean(axis=0)
        return to_up.apply(points), np.asarray(capsule.faces)
    square = to_up.apply(half * np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]))
    level = below - np.dot(below, up) * np.array(up)
    return level + square, np.array([(0, 1, 2), (0, 2, 3)])

"""Obstacles on the host: their shapes, and how they move from frame to frame."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.check import check_mesh
from balloon_warp.mesh.geometry import triangulate
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.placement import place_mesh, rotation_matrix
from balloon_warp.mesh.prepare import Treatment, prepared
from balloon_warp.mesh.topology import is_closed, mesh_edges
from balloon_warp.mesh.units import in_unit
from balloon_warp.scene import Obstacle, Scene

SHEET = 1.0e-3
"""thickness of a sheet over its size"""
MOST_TURN = 90.0
"""[degrees] in a frame"""
MOST_FRAMES = 1_000_000
"""that a motion may take"""


@dataclass(frozen=True)
class ObstacleShape:
    """An obstacle about its own origin, not turned."""

    kind: str
    size: NDArray[np.float64]
    """half the edges of a box; radius, half the length and 0 of a capsule; zeros of others [m], shape (3,)"""
    mesh: PolygonMesh | None
    """in meters, the scene's up axis up"""
    closed: bool
    """whether the mesh has an inside"""
    thickness: float
    """how far from the surface particles are held [m]"""
    reach: float
    """of the farthest point from the origin, with the thickness [m]; infinite for a plane"""

    @property
    def triangles(self) -> NDArray[np.int32]:
        """Of the mesh, shape (n, 3)."""
        return triangulate(self.mesh)[0] if self.mesh else np.zeros((0, 3), dtype=np.int32)


def shape_obstacle(number: int, obstacle: Obstacle, scene: Scene) -> ObstacleShape:
    """Read an obstacle's mesh and measure it.

    Raises:
        InputError: the mesh cannot be read, or has no face or no size.
    """
    mesh, closed, size, reach = None, True, np.zeros(3), np.inf
    if obstacle.shape == "box":
        size = 0.5 * np.array(obstacle.size)
        reach = float(np.linalg.norm(size))
    elif obstacle.shape == "capsule":
        size = np.array([obstacle.radius, 0.5 * obstacle.length, 0.0])
        reach = float(size.sum())
    elif obstacle.shape == "mesh":
        assert obstacle.mesh is not None  # as the schema sees to
        source = str(obstacle.mesh) if isinstance(obstacle.mesh, Path) else obstacle.mesh.name
        mesh = load_mesh(obstacle.mesh)
        check_mesh(mesh, source)
        mesh = prepared(mesh, source, Treatment(holes="keep", parts="free"))
        mesh = place_mesh(in_unit(mesh, obstacle.unit), scene.up_axis, obstacle.scale)
        closed = is_closed(mesh_edges(mesh))
        used = mesh.points[np.unique(mesh.face_vertex_indices)]
        reach = float(np.linalg.norm(used, axis=1).max())
        if np.ptp(used, axis=0).max() == 0.0:
            raise InputError(f"{source}: all its vertices stand at one place; expected a mesh with some size")
    thickness = obstacle.thickness
    if thickness is None:
        thickness = 0.0 if closed else SHEET * reach
    return ObstacleShape(obstacle.shape, size, mesh, closed, thickness, reach + thickness)


def warp_mesh(shape: ObstacleShape, device: wp.Device) -> wp.Mesh | None:
    """What kernels find the nearest place on its mesh with."""
    if shape.mesh is None:
        return None
    points = wp.array(shape.mesh.points, dtype=wp.vec3, device=device)
    return wp.Mesh(points, wp.array(shape.triangles.ravel(), dtype=wp.int32, device=device))


def obstacle_poses(positions: NDArray[np.floating], motion: NDArray[np.floating], frame: int) -> NDArray[np.float64]:
    """Where obstacles are at a frame: their origins [m], and quaternions (x, y, z, w), shape (..., obstacle_count, 7).

    Args:
        positions: as the scene or its worlds have them now [m], shape (..., obstacle_count, 3).
        motion: as `obstacle_motion` makes it.
    """
    moved = motion[min(frame, len(motion) - 1)]
    places = positions + moved[:, :3]
    turns = np.broadcast_to(moved[:, 3:], (*places.shape[:-1], 4))
    return np.concatenate([places, turns], axis=-1).astype(np.float64)


def moves(scene: Scene, number: int, changing: Iterable[Mapping[str, tuple[NDArray[np.bool_], Any]]]) -> bool:
    """Whether an obstacle is not at one place all the time.

    Args:
        changing: what each change of the scene changes, as `DueChange.values`.
    """
    changed = (values["obstacle_position"][0][number] for values in changing if "obstacle_position" in values)
    return bool(scene.obstacle[number].motion) or any(which.any() for which in changed)


def obstacle_motion(scene: Scene) -> NDArray[np.float64]:
    """Shifts of obstacles from their positions [m], and quaternions (x, y, z, w) of how they are turned, at the start
    of each frame until all rest, shape (frames, obstacle_count, 7); of one frame where none moves.

    Raises:
        InputError: one turns by more than a quarter in a frame, so that it is not known which way, or moves for longer
            than is kept.
    """
    lasts = {number: obstacle.motion[-1][0] for number, obstacle in enumerate(scene.obstacle) if obstacle.motion}
    for number, last in lasts.items():
        if last * scene.frames_per_second > MOST_FRAMES:
            most = MOST_FRAMES / scene.frames_per_second
            raise InputError(f"obstacle.{number}.motion: ends after {last:g} s; expected {most:g} s at most")
    frames = ceil(max(lasts.values()) * scene.frames_per_second) + 2 if lasts else 1
    times = np.arange(frames) / scene.frames_per_second
    motion = np.zeros((frames, len(scene.obstacle), 7))
    for number, obstacle in enumerate(scene.obstacle):
        keyframes = obstacle.motion or [(0.0, (0.0, 0.0, 0.0))]
        keys = [keyframe[0] for keyframe in keyframes]
        shifts = np.array([keyframe[1] for keyframe in keyframes])
        turns = np.array([keyframe[2] if len(keyframe) == 3 else (0.0, 0.0, 0.0) for keyframe in keyframes])
        for axis in range(3):
            motion[:, number, axis] = np.interp(times, keys, shifts[:, axis])
        about = np.stack([np.interp(times, keys, turns[:, axis]) for axis in range(3)], axis=1)
        fastest = float(np.abs(np.diff(about, axis=0)).max(initial=0.0))
        if fastest > MOST_TURN:
            raise InputError(
                f"obstacle.{number}.motion: turns by {fastest:.3g} degrees in a frame; expected at most {MOST_TURN:g}"
            )
        own = Rotation.from_matrix(rotation_matrix(obstacle.rotation))
        motion[:, number, 3:] = (Rotation.from_euler("xyz", about, degrees=True) * own).as_quat()
    return motion

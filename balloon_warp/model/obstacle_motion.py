"""Motion of obstacles from frame to frame: by keyframes of the scene, or by a USD stage."""

from collections.abc import Iterable, Mapping
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.placement import axes_matrix, rotation_matrix
from balloon_warp.mesh.units import as_told
from balloon_warp.mesh.usd import LOADERS as STAGES
from balloon_warp.scene import Obstacle, Scene

if TYPE_CHECKING:  # takes long to load, and most scenes have no obstacle
    from scipy.spatial.transform import Rotation

MOST_TURN = 90.0
"""Largest rotation in a frame [degrees]"""
MOST_FRAMES = 1_000_000
"""Largest number of frames of a motion"""


class Keyframes:
    """The motion that the scene says."""

    def __init__(self, obstacle: Obstacle):
        from scipy.spatial.transform import Rotation

        keyframes = obstacle.motion or [(0.0, (0.0, 0.0, 0.0))]
        self._times = [keyframe[0] for keyframe in keyframes]
        self._shifts = np.array([keyframe[1] for keyframe in keyframes])
        self._turns = np.array([keyframe[2] if len(keyframe) == 3 else (0.0, 0.0, 0.0) for keyframe in keyframes])
        self._own = Rotation.from_matrix(rotation_matrix(obstacle.rotation))
        self.seconds = self._times[-1] if obstacle.motion else 0.0

    def at(self, times: NDArray[np.float64]) -> "tuple[NDArray[np.float64], Rotation]":
        """Return the shifts from the position [m], shape (n, 3), and n turns."""
        from scipy.spatial.transform import Rotation

        turns = Rotation.from_euler("xyz", self._between(times, self._turns), degrees=True)
        return self._between(times, self._shifts), turns * self._own

    def fastest_turn(self, times: NDArray[np.float64]) -> float:
        """Return the largest rotation between successive times, about any axis [degrees]."""
        return float(np.abs(np.diff(self._between(times, self._turns), axis=0)).max(initial=0.0))

    def _between(self, times: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([np.interp(times, self._times, values[:, axis]) for axis in range(3)], axis=1)


class Sampled:
    """The motion that a USD stage has, beside the obstacle's own place and turn, which come after it."""

    def __init__(self, obstacle: Obstacle, scene: Scene, motion: Any):
        mesh = as_told(load_mesh(motion.path, obstacle.prim), obstacle.unit, obstacle.up)
        self._motion, self.seconds = motion, motion.seconds
        self._size = obstacle.scale * mesh.meters_per_unit
        self._axes = axes_matrix(mesh.up_axis, scene.up_axis)
        self._own = rotation_matrix(obstacle.rotation)

    def at(self, times: NDArray[np.float64]) -> "tuple[NDArray[np.float64], Rotation]":
        """Return shifts and rotations at times, as `Keyframes` does."""
        from scipy.spatial.transform import Rotation

        matrices = self._motion.matrices(times.clip(max=self.seconds))
        into = self._own @ self._axes
        shifts = self._size * matrices[:, :3, 3] @ into.T
        return shifts, Rotation.from_matrix(into @ matrices[:, :3, :3] @ self._axes.T)

    def fastest_turn(self, times: NDArray[np.float64]) -> float:
        """Return the largest rotation between successive times, as `Keyframes` does; no more than half a turn."""
        _, turns = self.at(times)
        return float(np.degrees((turns[1:] * turns[:-1].inv()).magnitude().max(initial=0.0)))


def motion_of(obstacle: Obstacle, scene: Scene) -> Keyframes | Sampled:
    """Return the motion of an obstacle.

    Raises:
        InputError: its mesh cannot be read.
    """
    moving = [motion for motion in _motions(obstacle) if motion.seconds > 0.0]
    return Sampled(obstacle, scene, moving[0]) if moving else Keyframes(obstacle)


def _motions(obstacle: Obstacle) -> list[Any]:
    """Return the motions of an obstacle in its stage, as `read_motions`.

    Empty where its mesh is not from a stage, or the scene moves it.

    Raises:
        InputError: its mesh cannot be read.
    """
    if obstacle.motion or not isinstance(obstacle.mesh, Path) or obstacle.mesh.suffix.lower() not in STAGES:
        return []
    from balloon_warp.mesh.usd_motion import read_motions  # loads USD

    load_mesh(obstacle.mesh, obstacle.prim)  # or a file that is none gets another sentence
    return read_motions(obstacle.mesh, obstacle.prim)


def with_parts_apart(scene: Scene) -> Scene:
    """Return the scene with an obstacle for each part of a stage that moves by itself.

    The first part keeps the obstacle's number; the others follow behind all obstacles, with the same values.

    Raises:
        InputError: a mesh cannot be read.
    """
    first, others = [], []
    for obstacle in scene.obstacle:
        motions = _motions(obstacle)
        parts = [
            obstacle.model_copy(
                update={
                    "prim": [str(prim.GetPath()) for prim in motion.prims],
                    "name": "_".join(filter(None, (obstacle.name, motion.prims[0].GetName()))),
                }
            )
            for motion in motions
        ]
        first.append(parts[0] if len(parts) > 1 else obstacle)
        others += parts[1:]
    return scene.model_copy(update={"obstacle": first + others}) if others else scene


def obstacle_poses(positions: NDArray[np.floating], motion: NDArray[np.floating], frame: int) -> NDArray[np.float64]:
    """Return obstacle poses at a frame: origins [m] and quaternions (x, y, z, w), shape (..., obstacle_count, 7).

    Args:
        positions: Current positions by the scene or its worlds [m], shape (..., obstacle_count, 3).
        motion: Motion, as from `obstacle_motion`.
    """
    moved = motion[min(frame, len(motion) - 1)]
    places = positions + moved[:, :3]
    turns = np.broadcast_to(moved[:, 3:], (*places.shape[:-1], 4))
    return np.concatenate([places, turns], axis=-1).astype(np.float64)


def moves(scene: Scene, number: int, changing: Iterable[Mapping[str, tuple[NDArray[np.bool_], Any]]]) -> bool:
    """Return whether an obstacle moves at any time.

    Args:
        changing: Values changed by each change of the scene, as in `DueChange.values`.
    """
    changed = (values["obstacle_position"][0][number] for values in changing if "obstacle_position" in values)
    return motion_of(scene.obstacle[number], scene).seconds > 0.0 or any(which.any() for which in changed)


def obstacle_motion(scene: Scene) -> NDArray[np.float64]:
    """Return the motion of obstacles until all rest, shape (frames, obstacle_count, 7).

    Shifts from their positions [m] and rotations as quaternions (x, y, z, w), at the start of each frame; one frame
    where none moves.

    Raises:
        InputError: one turns by more than a quarter in a frame, so that it is not known which way, or moves for longer
            than is kept, or does not keep its size.
    """
    if not scene.obstacle:
        return np.zeros((1, 0, 7))
    courses = [motion_of(obstacle, scene) for obstacle in scene.obstacle]
    for number, course in enumerate(courses):
        if course.seconds * scene.frames_per_second > MOST_FRAMES:
            most = MOST_FRAMES / scene.frames_per_second
            raise InputError(f"obstacle.{number}.motion: ends after {course.seconds:g} s; expected {most:g} s at most")
    longest = max((course.seconds for course in courses), default=0.0)
    frames = ceil(longest * scene.frames_per_second) + 2 if longest > 0.0 else 1
    times = np.arange(frames) / scene.frames_per_second
    motion = np.zeros((frames, len(courses), 7))
    for number, course in enumerate(courses):
        shifts, turns = course.at(times)
        fastest = course.fastest_turn(times) if frames > 1 else 0.0
        if fastest > MOST_TURN:
            raise InputError(
                f"obstacle.{number}.motion: turns by {fastest:.3g} degrees in a frame; expected at most {MOST_TURN:g}"
            )
        motion[:, number, :3], motion[:, number, 3:] = shifts, turns.as_quat()
    return motion

"""Anchors of strings that move: with an obstacle, with a free body, or by keyframes."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import Self

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.model.bodies import BodyShape
from balloon_warp.model.obstacle_motion import MOST_FRAMES, obstacle_motion
from balloon_warp.scene import Scene

Values = NDArray[np.floating]
REST = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
"""No shift and no rotation"""


@dataclass(frozen=True)
class Carriers:
    """Carriers of the anchors of strings."""

    obstacles: NDArray[np.int32]
    """Obstacle that carries each anchor, or -1, shape (string_count,)"""
    bodies: NDArray[np.int32]
    """Free body that carries each, or -1, likewise"""
    centers: NDArray[np.float64]
    """Center of mass of that body, from its own origin [m], shape (string_count, 3)"""
    motion: NDArray[np.float64]
    """Motion of each anchor by itself, as from `anchor_motion`"""

    @classmethod
    def of(cls, scene: Scene, bodies: Sequence[BodyShape]) -> Self:
        """Return the carriers of a scene's strings.

        Raises:
            InputError: as `anchor_motion`.
        """
        named = [(string.obstacle, string.body) for string in scene.string]
        numbers = np.array([[-1 if each is None else each for each in pair] for pair in named], dtype=np.int32)
        obstacles, carrying = numbers.reshape(-1, 2).T
        centers = [np.zeros(3) if number < 0 else bodies[number].center for number in carrying.tolist()]
        return cls(obstacles, carrying, np.array(centers).reshape(-1, 3), anchor_motion(scene))

    def anchors_at(self, anchors: Values, positions: Values, poses: Values, frame: float) -> NDArray[np.float64]:
        """Return the anchors of strings at a frame, or between two [m], shape (..., string_count, 3).

        Args:
            anchors: by the scene or its worlds [m], shape (..., string_count, 3).
            positions: of obstacles [m], shape (..., obstacle_count, 3).
            poses: centers of mass [m] and turns of bodies then, as `Frame.body_poses`, shape (..., body_count, 7).
            frame: since the world began.
        """
        if len(self.motion) == 1:
            return np.asarray(anchors, dtype=np.float64)
        first, part = int(frame), frame - int(frame)
        begin, end = (
            _moved(self.motion[min(each, len(self.motion) - 1)], anchors - self.centers) for each in (first, first + 1)
        )
        moved = begin + part * (end - begin)
        if positions.shape[-2]:
            moved = moved + np.where((self.obstacles >= 0)[:, None], positions[..., self.obstacles.clip(min=0), :], 0.0)
        if poses.shape[-2]:
            on_bodies = _moved(poses[..., self.bodies.clip(min=0), :], anchors - self.centers)
            moved = np.where((self.bodies >= 0)[:, None], on_bodies, moved)
        return moved


def anchor_motion(scene: Scene) -> NDArray[np.float64]:
    """Return the motion of anchors until all rest, as `obstacle_motion`, shape (frames, string_count, 7).

    One frame where none moves; of one that an obstacle carries, the obstacle's; of one on a body, rest.

    Raises:
        InputError: one moves for longer than is kept, or as `obstacle_motion`.
    """
    if not any(string.moves for string in scene.string):
        return np.tile(REST, (1, len(scene.string), 1))
    rate, of_obstacles = scene.frames_per_second, obstacle_motion(scene)
    seconds = [string.motion[-1][0] if string.motion else 0.0 for string in scene.string]
    for number, longest in enumerate(seconds):
        if longest * rate > MOST_FRAMES:
            raise InputError(
                f"string.{number}.motion: ends after {longest:g} s; expected {MOST_FRAMES / rate:g} s at most"
            )
    frames = max(ceil(max(seconds) * rate) + 2, len(of_obstacles))
    motion, times = np.tile(REST, (frames, len(scene.string), 1)), np.arange(frames) / rate
    for number, string in enumerate(scene.string):
        if string.obstacle is not None:
            motion[:, number] = of_obstacles[np.minimum(np.arange(frames), len(of_obstacles) - 1), string.obstacle]
        elif string.motion:
            shifts = np.array([shift for _, shift in string.motion])
            told = [time for time, _ in string.motion]
            motion[:, number, :3] = np.stack([np.interp(times, told, shift) for shift in shifts.T], axis=1)
    return motion


def _moved(poses: Values, places: Values) -> NDArray[np.float64]:
    """Return places after shifts and turns, shape (..., n, 3), of shape (..., n, 7)."""
    axis, scalar = poses[..., 3:6], poses[..., 6:]
    across = 2.0 * np.cross(axis, places)
    return poses[..., :3] + places + scalar * across + np.cross(axis, across)

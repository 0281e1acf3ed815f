"""Anchors of strings that move: with an obstacle, or by keyframes."""

from math import ceil

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.model.obstacle_motion import MOST_FRAMES, obstacle_motion
from balloon_warp.scene import Scene

Values = NDArray[np.floating]
REST = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
"""No shift and no rotation"""


def carriers(scene: Scene) -> NDArray[np.int32]:
    """Return the obstacle that carries each string's anchor, -1 where none does, shape (string_count,)."""
    return np.array([-1 if string.obstacle is None else string.obstacle for string in scene.string], dtype=np.int32)


def anchor_motion(scene: Scene) -> NDArray[np.float64]:
    """Return the motion of anchors until all rest, as `obstacle_motion`, shape (frames, string_count, 7).

    One frame where none moves; of one that an obstacle carries, the obstacle's.

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


def anchors_at(
    anchors: Values, positions: Values, carried: NDArray[np.int32], motion: Values, frame: float
) -> NDArray[np.float64]:
    """Return the anchors of strings at a frame, or between two [m], shape (..., string_count, 3).

    Args:
        anchors: by the scene or its worlds [m], shape (..., string_count, 3).
        positions: of obstacles [m], shape (..., obstacle_count, 3).
        carried: as from `carriers`.
        motion: as from `anchor_motion`.
    """
    if len(motion) == 1:
        return np.asarray(anchors, dtype=np.float64)
    first, part = int(frame), frame - int(frame)
    begin, end = (_moved(anchors, motion[min(each, len(motion) - 1)]) for each in (first, first + 1))
    moved = begin + part * (end - begin)
    if positions.shape[-2]:
        moved = moved + np.where((carried >= 0)[:, None], positions[..., carried.clip(min=0), :], 0.0)
    return moved


def _moved(anchors: Values, poses: Values) -> NDArray[np.float64]:
    axis, scalar = poses[:, 3:6], poses[:, 6:]
    across = 2.0 * np.cross(axis, anchors)
    return poses[:, :3] + anchors + scalar * across + np.cross(axis, across)

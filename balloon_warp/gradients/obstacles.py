"""Derivatives by where obstacles are, by keyframes of their motion, and by the friction of balloons on them."""

import re

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.gradients.spans import Slopes
from balloon_warp.model import Model, ModelPlan
from balloon_warp.model.friction import FRICTION
from balloon_warp.scene import Scene
from balloon_warp.schedules.backward_fixtures import POSITION, FixturesBackward

Values = NDArray[np.float64]
KEYFRAMES = "obstacle_keyframes"
"""Name of the places of obstacles at their keyframes, shape (W, N, keyframe_count, 3), as bars and slopes have them"""
OF_MOTION = re.compile(r"obstacle\.(\d+)\.motion\.(\d+)\.1\.([012])")
"""Path of a coordinate of an obstacle's place at a keyframe"""
FIRST = 1
"""Number of the first obstacle among all things"""


def is_of_motion(path: str) -> bool:
    """Return whether a path leads to the motion of an obstacle."""
    return path.startswith("obstacle.") and path.split(".")[2:3] == ["motion"]


def slopes_of_motion(plan: ModelPlan, path: str) -> Slopes:
    """Return the slopes by a coordinate of an obstacle's place at a keyframe.

    Raises:
        InputError: there is no such keyframe, or the path leads to no coordinate of a place.
    """
    told, obstacles = OF_MOTION.fullmatch(path), plan.scene.obstacle
    number = int(each) if (each := path.split(".")[1]).isdecimal() else len(obstacles)
    if number >= len(obstacles):
        raise InputError(f"{path}: the scene has {len(obstacles)} obstacles; expected obstacle.NUMBER, from 0")
    count = len(obstacles[number].motion or ())
    if not told or int(told[2]) >= count:
        raise InputError(
            f"{path}: obstacle {number} has {count} keyframes; expected obstacle.{number}.motion.KEYFRAME.1.AXIS, from "
            "0, which is a coordinate of its place then"
        )
    slopes = np.zeros((plan.world_count, len(obstacles), _most_keyframes(plan.scene), 3))
    slopes[:, number, int(told[2]), int(told[3])] = 1.0
    return {KEYFRAMES: slopes}


def _most_keyframes(scene: Scene) -> int:
    return max((len(obstacle.motion or ()) for obstacle in scene.obstacle), default=0)


def is_on_obstacles(plan: ModelPlan, slopes: Values) -> bool:
    """Return whether any coefficient of a balloon on an obstacle grows, of those of all pairs of things."""
    last = FIRST + len(plan.scene.obstacle)
    return bool(slopes[:, slopes.shape[1] - len(plan.shapes) :, FIRST:last].any())


class ByObstacles:
    """Collect the bars of obstacles, frame by frame.

    Args:
        backward: of contacts with obstacles, which finds them.
    """

    def __init__(self, plan: ModelPlan, model: Model, backward: FixturesBackward):
        self._scene, self._model, self._backward = plan.scene, model, backward
        self._keyframes = np.zeros((model.world_count, len(model.obstacles), _most_keyframes(plan.scene), 3))
        self._positions = np.zeros((model.world_count, len(model.obstacles), 3))
        self._frictions = np.zeros((model.world_count, model.balloon_count, len(model.obstacles)))

    def note(self, frame: int) -> None:
        """Add the bars of a frame that has run backwards."""
        places, frictions = self._backward.of_frame()
        self._positions += places.sum(axis=2)
        self._frictions += frictions
        for number, obstacle in enumerate(self._scene.obstacle):
            if obstacle.motion:
                times = [keyframe[0] for keyframe in obstacle.motion]
                for end in (0, 1):
                    time = (frame + end) * self._model.frame_seconds
                    weights = np.array([np.interp(time, times, unit) for unit in np.eye(len(times))])
                    self._keyframes[:, number, : len(times)] += weights[:, None] * places[:, number, None, end]

    def taken_numbers(self) -> dict[str, Values]:
        """Return the bars since they were last taken, by the names of parameters."""
        of_pairs = np.zeros((self._model.world_count, *self._model.parameters[FRICTION].shape[1:]))
        of_pairs[:, -self._model.balloon_count :, FIRST : FIRST + len(self._model.obstacles)] = self._frictions
        taken = {POSITION: self._positions, KEYFRAMES: self._keyframes, FRICTION: of_pairs}
        self._positions, self._keyframes, self._frictions = (
            np.zeros_like(array) for array in (self._positions, self._keyframes, self._frictions)
        )
        return taken

"""`BalloonWarp/Press-v0`: a gripper of two plates lifts a balloon by friction, without bursting it."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels import OPTIONS
from balloon_warp.learn.task import Task
from balloon_warp.mesh.topology import quad_sphere
from balloon_warp.scene import Balloon, Ground, Inflation, Obstacle, Scene
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_threads import launch

wp.set_module_options(OPTIONS)
RADIUS, THICK = 0.15, 0.04
"""Radius of the balloon, and thickness of the plates [m]"""
MOST_SPEED = 0.5
"""Largest speed of the plates [m/s]"""
MOST_PRESSURE = 900.0
"""Pressure at which the balloon bursts [Pa]; 300 at rest"""
GOAL_HEIGHT = 0.5
"""Goal for the height of the balloon's center [m]"""
NARROW, WIDE, TOP = 0.04, 0.3, 1.0
"""Least and largest distance of a plate from the middle, and largest height [m]"""
SPEED, GOAL, BURSTS = wp.constant(MOST_SPEED), wp.constant(GOAL_HEIGHT), wp.constant(MOST_PRESSURE)
REST_HEIGHT = wp.constant(RADIUS)
LEAST, MOST, HIGHEST = wp.constant(NARROW), wp.constant(WIDE), wp.constant(TOP)


@wp.kernel
def move_plates(
    actions: wp.array2d[float], places: wp.array2d[wp.vec3], left: wp.array2d[float], right: wp.array2d[float]
):
    """Close the gripper by the first action, and lift it by the second."""
    world = wp.tid()
    closing = SPEED * actions[world, 0]
    lifting = SPEED * actions[world, 1]
    apart = places[world, 1][0]
    if (apart < LEAST and closing > 0.0) or (apart > MOST and closing < 0.0):
        closing = 0.0
    height = places[world, 1][1]
    if (height > HIGHEST and lifting > 0.0) or (height < REST_HEIGHT and lifting < 0.0):
        lifting = 0.0
    left[world, 0] = closing
    right[world, 0] = -closing
    left[world, 1] = lifting
    right[world, 1] = lifting


@wp.kernel
def judge_lift(
    centers: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    pressures: wp.array2d[float],
    plates: wp.array2d[wp.vec3],
    # out
    observations: wp.array2d[float],
    rewards: wp.array[float],
    terminated: wp.array[wp.int32],
):
    """Reward height, up to the goal; a balloon that bursts or slips away ends the episode."""
    world = wp.tid()
    center = centers[world, 0]
    observations[world, 0] = center[1]
    observations[world, 1] = velocities[world, 0][1]
    observations[world, 2] = pressures[world, 0] / BURSTS
    observations[world, 3] = plates[world, 1][0]
    observations[world, 4] = plates[world, 1][1]
    observations[world, 5] = center[0]
    observations[world, 6] = center[2]
    rewards[world] = wp.clamp((center[1] - REST_HEIGHT) / (GOAL - REST_HEIGHT), 0.0, 1.0)
    if pressures[world, 0] > BURSTS or wp.length(wp.vec2(center[0], center[2])) > 0.5:
        rewards[world] = 0.0
        terminated[world] = 1


class Press(Task):
    """Lift a balloon to half a meter, within 5 s."""

    actions, observations, most_steps = 2, 7, 300
    observation_limits = (5.0, 20.0, 10.0, 2.0, 2.0, 5.0, 5.0)

    def scene(self) -> Scene:
        """Return a balloon of sealed air on the ground, between two plates."""
        ball = Balloon(
            mesh=quad_sphere(5, RADIUS),
            position=(0.0, RADIUS, 0.0),
            mass=0.03,
            inflation=Inflation(kind="gas", molar_mass=0.029, start_pressure=300.0),
            friction=0.8,
            damping=3.0,
        )
        plates = [
            Obstacle(size=(THICK, 0.3, 0.4), position=(side * (WIDE - 0.05), RADIUS + 0.01, 0.0), friction=0.8)
            for side in (-1.0, 1.0)
        ]
        return Scene(balloon=[ball], obstacle=plates, ground=Ground(), touch=False, faces=False)

    def begin(self, simulator: Simulator) -> None:
        """Control both plates' velocities, and draw the balloon's mass."""
        self._worlds, self._device = simulator.model.world_count, simulator.model.device
        paths = (f"obstacle.{number}.velocity" for number in range(2))
        self._plates = [simulator.controls.open(path, -MOST_SPEED, MOST_SPEED) for path in paths]
        names = ("centers", "velocities", "pressures", "obstacle_positions")
        self._seen = [simulator.observations[name] for name in names]
        simulator.starts.draw("balloon.mass", 0.02, 0.06)

    def act(self, actions: wp.array) -> None:
        """Close and lift the gripper."""
        launch(move_plates, self._worlds, [actions, self._seen[3]], self._plates, device=self._device)

    def judge(self, observations: wp.array, rewards: wp.array, terminated: wp.array) -> None:
        """See height and its rate, pressure over its limit, the right plate's place, and how far off the middle."""
        launch(judge_lift, self._worlds, self._seen, [observations, rewards, terminated], device=self._device)

    @staticmethod
    def policy(observations: NDArray[Any]) -> NDArray[Any]:
        """Close until the balloon is squeezed, then lift."""
        apart, plate, center = observations[:, 3], observations[:, 4], observations[:, 0]
        closing = 20.0 * (apart - 0.115)
        lifting = np.where(apart < 0.12, 3.0 * (GOAL_HEIGHT - center), 0.0)
        slipped = (plate - center > 0.12) & (plate > 0.3)
        return np.clip(np.stack([closing, np.where(slipped, -1.0, lifting)], axis=1), -1.0, 1.0)

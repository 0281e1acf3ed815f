"""`BalloonWarp/Juggle-v0`: keep a balloon up with a plate, in wind that is drawn."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels import OPTIONS
from balloon_warp.learn.task import Task
from balloon_warp.mesh.topology import quad_sphere
from balloon_warp.scene import Balloon, Inflation, Obstacle, Scene, Stiffness
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_threads import launch

wp.set_module_options(OPTIONS)
RADIUS, PLATE, THICK = 0.15, 0.6, 0.2
"""Radius of the balloon, and width and thickness of the plate [m]"""
MOST_SPEED = 2.0
"""Largest velocity of the plate along each axis [m/s]"""
HIGH, LOW = 0.5, -0.6
"""Height above which a balloon is up, and below which it is lost [m]"""
SPEED, UP, LOST = wp.constant(MOST_SPEED), wp.constant(HIGH), wp.constant(LOW)


@wp.kernel
def move_plate(actions: wp.array2d[float], places: wp.array2d[wp.vec3], velocities: wp.array2d[float]):
    """Move the plate, which stays within two meters of the origin."""
    world = wp.tid()
    for axis in range(3):
        place = places[world, 0][axis]
        velocity = SPEED * actions[world, axis]
        if wp.abs(place) > 2.0 and place * velocity > 0.0:
            velocity = 0.0
        velocities[world, axis] = velocity


@wp.kernel
def judge_balloon(
    centers: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    plates: wp.array2d[wp.vec3],
    # out
    observations: wp.array2d[float],
    rewards: wp.array[float],
    terminated: wp.array[wp.int32],
):
    """Reward a balloon that is up; one that is lost ends the episode."""
    world = wp.tid()
    center = centers[world, 0]
    for axis in range(3):
        observations[world, axis] = center[axis]
        observations[world, 3 + axis] = velocities[world, 0][axis]
        observations[world, 6 + axis] = plates[world, 0][axis]
    rewards[world] = wp.where(center[1] > UP, 1.0, 0.0)
    if center[1] < LOST or wp.length(wp.vec2(center[0], center[2])) > 3.0:
        rewards[world] = 0.0
        terminated[world] = 1


class Juggle(Task):
    """Keep a balloon above half a meter, for 10 s."""

    actions, observations, most_steps = 3, 9, 600
    observation_limits = (10.0, 10.0, 10.0, 50.0, 50.0, 50.0, 3.0, 3.0, 3.0)

    def scene(self) -> Scene:
        """Return a balloon of 152 particles in the air above a plate."""
        ball = Balloon(
            mesh=quad_sphere(5, RADIUS),
            position=(0.0, 0.8, 0.0),
            mass=0.02,
            inflation=Inflation(pressure=20.0),
            stiffness=Stiffness(structural=40.0, shear=20.0, flexion=5.0),
            drag_coefficient=0.47,
            damping=0.0,
        )
        plate = Obstacle(size=(PLATE, THICK, PLATE), position=(0.0, 0.0, 0.0), friction=0.8)
        return Scene(balloon=[ball], obstacle=[plate], touch=False, faces=False)

    def begin(self, simulator: Simulator) -> None:
        """Control the plate's velocity, and draw the balloon's and the wind."""
        self._worlds, self._device = simulator.model.world_count, simulator.model.device
        self._velocity = simulator.controls.open("obstacle.0.velocity", -MOST_SPEED, MOST_SPEED)
        names = ("centers", "velocities", "obstacle_positions")
        self._seen = [simulator.observations[name] for name in names]
        for axis in (0, 2):
            simulator.starts.draw(f"balloon.velocity.{axis}", -0.5, 0.5)
            simulator.starts.draw(f"atmosphere.wind.{axis}", -0.15, 0.15)

    def act(self, actions: wp.array) -> None:
        """Move the plate."""
        launch(move_plate, self._worlds, [actions, self._seen[2]], [self._velocity], device=self._device)

    def judge(self, observations: wp.array, rewards: wp.array, terminated: wp.array) -> None:
        """See the balloon's center and velocity, and where the plate is [m], [m/s]."""
        told = [observations, rewards, terminated]
        launch(judge_balloon, self._worlds, self._seen, told, device=self._device)

    @staticmethod
    def policy(observations: NDArray[Any]) -> NDArray[Any]:
        """Go where the balloon comes down, and hit it when it is near."""
        center, velocity, plate = (observations[:, part : part + 3] for part in (0, 3, 6))
        action = 4.0 * (center + 0.15 * velocity - plate)
        above = center[:, 1] - plate[:, 1] - 0.5 * THICK - RADIUS
        hits = (velocity[:, 1] < 0.5) & (above < 0.15)
        action[:, 1] = np.where(hits, 0.6, 2.0 * (0.1 - plate[:, 1]))
        return np.clip(action, -1.0, 1.0)

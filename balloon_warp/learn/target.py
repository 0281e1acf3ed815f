"""`BalloonWarp/Target-v0`: a balloon with a jet that turns flies through a ring."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.laws import Parameter
from balloon_warp.laws import particle_law
from balloon_warp.learn.task import Task
from balloon_warp.mesh.topology import quad_sphere
from balloon_warp.scene import Balloon, Inflation, Scene
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_threads import launch

wp.set_module_options(OPTIONS)
DISTANCE, RING = 2.0, 0.25
"""Distance of the ring from the start, and its radius [m]"""
MOST_JET = 0.15
"""Thrust of the jet along each axis [N]; the balloon weighs 0.1 N"""
FAR, WIDE, JET = wp.constant(DISTANCE), wp.constant(RING), wp.constant(MOST_JET)


@wp.func
def thrust(mass_share: float, jet: wp.vec3):
    """Share a jet's thrust among the particles of a balloon."""
    return mass_share * jet


@wp.kernel
def turn_jet(actions: wp.array2d[float], jet: wp.array2d[float]):
    """Turn the jet."""
    world = wp.tid()
    for axis in range(3):
        jet[world, axis] = JET * actions[world, axis]


@wp.kernel
def judge_flight(
    centers: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    heights: wp.array[float],
    sides: wp.array[float],
    # out
    observations: wp.array2d[float],
    rewards: wp.array[float],
    terminated: wp.array[wp.int32],
):
    """Reward a flight through the ring by 10, and one towards it by a hundredth of the speed in that direction."""
    world = wp.tid()
    ring = wp.vec3(FAR, heights[world], sides[world])
    way = ring - centers[world, 0]
    for axis in range(3):
        observations[world, axis] = way[axis]
        observations[world, 3 + axis] = velocities[world, 0][axis]
    rewards[world] = 0.01 * wp.dot(velocities[world, 0], wp.normalize(way))
    if way[0] < 0.0:
        rewards[world] = wp.where(wp.length(wp.vec2(way[1], way[2])) < WIDE, 10.0, 0.0)
        terminated[world] = 1
    if wp.length(way) > 4.0:
        terminated[world] = 1


class Target(Task):
    """Fly through a ring that stands somewhere two meters away, within 5 s."""

    actions, observations, most_steps = 3, 6, 300
    observation_limits = (10.0, 10.0, 10.0, 50.0, 50.0, 50.0)

    def scene(self) -> Scene:
        """Return a balloon of 152 particles in the air."""
        ball = Balloon(
            mesh=quad_sphere(5, 0.15),
            mass=0.01,
            inflation=Inflation(pressure=5.0),
            drag_coefficient=0.47,
            damping=0.0,
        )
        return Scene(balloon=[ball], touch=False)

    def laws(self) -> tuple[Any, ...]:
        """Return the law of the jet."""
        return (particle_law(thrust, [Parameter("jet", "N", size=3, meaning="thrust")]),)

    def begin(self, simulator: Simulator) -> None:
        """Control the jet, and draw the place of the ring."""
        self._worlds, self._device = simulator.model.world_count, simulator.model.device
        self._jet = simulator.controls.open("balloon.law.thrust.jet", -MOST_JET, MOST_JET)
        ring = [simulator.starts.value(name, -0.7, 0.7) for name in ("height", "side")]
        self._seen = [simulator.observations["centers"], simulator.observations["velocities"], *ring]

    def act(self, actions: wp.array) -> None:
        """Turn the jet."""
        launch(turn_jet, self._worlds, [actions], [self._jet], device=self._device)

    def judge(self, observations: wp.array, rewards: wp.array, terminated: wp.array) -> None:
        """See the way to the ring's middle, and the velocity [m], [m/s]."""
        launch(judge_flight, self._worlds, self._seen, [observations, rewards, terminated], device=self._device)

    @staticmethod
    def policy(observations: NDArray[Any]) -> NDArray[Any]:
        """Fly slowly forwards, and steer to the ring's axis against weight and speed."""
        way, velocity = observations[:, :3], observations[:, 3:6]
        action = 2.0 * way - 1.0 * velocity
        action[:, 0] = 0.3 - 0.3 * velocity[:, 0]
        action[:, 1] += 0.65
        return np.clip(action, -1.0, 1.0)

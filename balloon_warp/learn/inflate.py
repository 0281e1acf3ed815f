"""`BalloonWarp/Inflate-v0`: blow a balloon of latex up to a volume that is drawn, without overstretching its skin."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.laws.air import DRY_AIR_MOLAR_MASS
from balloon_warp.learn.task import Task
from balloon_warp.mesh.topology import quad_sphere
from balloon_warp.scene import Balloon, Inflation, Material, Scene
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_threads import launch

wp.set_module_options(OPTIONS)
RADIUS = 0.05
"""Radius of the balloon at rest [m]"""
MOST_STRETCH = 2.6
"""Stretch of the skin at which the balloon bursts [1]"""
MOST_PUMP = 0.2
"""Air in or out [mol/s]"""
LEAST_GROWTH, MOST_GROWTH = 3.0, 10.0
"""Volumes that are asked for, over that at rest"""
FLOW, LIMIT, LOAD = wp.constant(MOST_PUMP), wp.constant(MOST_STRETCH), wp.constant(2000.0)


@wp.kernel
def pump_air(actions: wp.array2d[float], pump: wp.array[float]):
    """Pump air in or out."""
    world = wp.tid()
    pump[world] = FLOW * actions[world, 0]


@wp.kernel
def judge_volume(
    volumes: wp.array2d[float],
    pressures: wp.array2d[float],
    stretches: wp.array2d[float],
    goals: wp.array[float],
    rest: float,
    # out
    observations: wp.array2d[float],
    rewards: wp.array[float],
    terminated: wp.array[wp.int32],
):
    """Reward closeness to the goal volume; a skin that is stretched too far ends the episode."""
    world = wp.tid()
    growth = volumes[world, 0] / rest
    missing = wp.log(wp.max(growth, 0.1) / goals[world])
    observations[world, 0] = missing
    observations[world, 1] = growth / 10.0
    observations[world, 2] = pressures[world, 0] / LOAD
    observations[world, 3] = stretches[world, 0] / LIMIT
    rewards[world] = wp.exp(-10.0 * wp.abs(missing))
    if stretches[world, 0] > LIMIT:
        rewards[world] = 0.0
        terminated[world] = 1


class Inflate(Task):
    """Reach a volume between three and ten times that at rest, within 2 s."""

    actions, observations, most_steps = 1, 4, 120
    observation_limits = (5.0, 10.0, 10.0, 5.0)

    def scene(self) -> Scene:
        """Return a latex balloon of 152 particles that weighs nothing and is filled with air."""
        return Scene(
            balloon=[
                Balloon(
                    mesh=quad_sphere(5, RADIUS),
                    material=Material(preset="latex", most_stretch=1.2 * MOST_STRETCH),
                    inflation=Inflation(kind="gas", molar_mass=DRY_AIR_MOLAR_MASS),
                    damping=5.0,
                )
            ],
            gravity=0.0,
            touch=False,
        )

    def begin(self, simulator: Simulator) -> None:
        """Control the pump, and draw the volume."""
        self._worlds, self._device = simulator.model.world_count, simulator.model.device
        self._pump = simulator.controls.open("balloon.inflation.pump", -MOST_PUMP, MOST_PUMP)
        names = ("volumes", "pressures", "stretches")
        self._seen = [simulator.observations[name] for name in names]
        self._rest = float(self._seen[0].numpy()[0, 0])
        self._goals = simulator.starts.value("goal", LEAST_GROWTH, MOST_GROWTH, "log_uniform")

    def act(self, actions: wp.array) -> None:
        """Pump air in or out."""
        launch(pump_air, self._worlds, [actions], [self._pump], device=self._device)

    def judge(self, observations: wp.array, rewards: wp.array, terminated: wp.array) -> None:
        """See the logarithm of volume over goal, the volume, the pressure, and the stretch over its limit."""
        inputs = [*self._seen, self._goals, self._rest]
        launch(judge_volume, self._worlds, inputs, [observations, rewards, terminated], device=self._device)

    @staticmethod
    def policy(observations: NDArray[Any]) -> NDArray[Any]:
        """Pump in proportion to the logarithm of the missing growth."""
        return np.clip(-8.0 * observations[:, :1], -1.0, 1.0)

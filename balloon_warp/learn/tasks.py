"""`BalloonWarp/Altitude-v0`: hold a superpressure balloon at a height, by a pump and a vent, in wind that shears.

As in the Balloon Learning Environment (Bellemare et al. 2020, Autonomous navigation of stratospheric balloons using
reinforcement learning): helium lifts, and air that is pumped in is ballast. Here the film itself is simulated.
"""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.laws.air import DRY_AIR_MOLAR_MASS, GAS_CONSTANT
from balloon_warp.learn.task import Task
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import quad_sphere, signed_volume, total_area
from balloon_warp.scene import Atmosphere, Balloon, Inflation, Material, Scene
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_threads import launch

wp.set_module_options(OPTIONS)
VOLUME, COMPLIANCE = 1804.0, 0.0199
"""Volume without superpressure [m^3], and its growth [m^3/Pa], of that environment's balloon"""
PRESSURE, TEMPERATURE = 7565.0, 216.65
"""Pressure and temperature of the air at height 0, 18 km up [Pa], [K]"""
GRAVITY, HELIUM_MOLAR_MASS = 9.81, 0.0040026
START_PRESSURE, BALLAST = 300.0, 300.0
"""Superpressure [Pa], and air within [mol], at the start"""
THICKNESS = 1.0e-4
MOST_PUMP = 40.0
"""Air in or out [mol/s]"""
HEIGHT, SPEED, SUPERPRESSURE = 10.0, 2.0, 1000.0
"""Units of the observations [m], [m/s], [Pa]"""
MIDDLE = 50.0
"""Height at the start, above 18 km [m]"""
THIN = np.exp(-DRY_AIR_MOLAR_MASS * GRAVITY * MIDDLE / (GAS_CONSTANT * TEMPERATURE))
"""Density of the air there over that at height 0"""
LENGTH, PACE, LOAD = wp.constant(HEIGHT), wp.constant(SPEED), wp.constant(SUPERPRESSURE)
AIR_WITHIN = wp.constant(BALLAST)
FLOW, HELIUM, AIR = wp.constant(MOST_PUMP), wp.constant(HELIUM_MOLAR_MASS), wp.constant(DRY_AIR_MOLAR_MASS)


def envelope() -> PolygonMesh:
    """Return the envelope, a sphere of 488 particles that encloses the volume."""
    return quad_sphere(9, (VOLUME / signed_volume(quad_sphere(9, 1.0))) ** (1.0 / 3.0))


def stiff_film(mass: float, mesh: PolygonMesh) -> Material:
    """Return the film of that compliance: of a sphere dV/dp = 2 pi r^4 (1 - nu) / (E h), with nu = 1/2, E = 3 mu."""
    radius = (0.75 * VOLUME / np.pi) ** (1.0 / 3.0)
    modulus = np.pi * radius**4 / (3.0 * COMPLIANCE * THICKNESS)
    density = mass / (total_area(mesh) * THICKNESS)
    return Material(kind="neo_hookean", shear_modulus=modulus, thickness=THICKNESS, density=density, most_stretch=1.05)


@wp.kernel
def pump_air(
    actions: wp.array2d[float],
    gas_amounts: wp.array2d[wp.float64],
    helium: float,
    # out
    pump: wp.array[float],
    molar_mass: wp.array[float],
):
    """Pump air in or out, as long as there is some, and mix the molar mass of the gas within."""
    world = wp.tid()
    amount = float(gas_amounts[world, 0])
    air = wp.max(amount - helium, 0.0)
    flow = FLOW * actions[world, 0]
    if air <= 0.0:
        flow = wp.max(flow, 0.0)
    pump[world] = flow
    molar_mass[world] = (helium * HELIUM + air * AIR) / (helium + air)


@wp.kernel
def judge_height(
    centers: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    pressures: wp.array2d[float],
    gas_amounts: wp.array2d[wp.float64],
    helium: float,
    goals: wp.array[float],
    # out
    observations: wp.array2d[float],
    rewards: wp.array[float],
    terminated: wp.array[wp.int32],
):
    """Reward closeness to the goal height; the film bursts above twice its design superpressure."""
    world = wp.tid()
    above = centers[world, 0][1] - goals[world]
    observations[world, 0] = above / LENGTH
    observations[world, 1] = velocities[world, 0][1] / PACE
    observations[world, 2] = pressures[world, 0] / LOAD
    observations[world, 3] = (float(gas_amounts[world, 0]) - helium) / AIR_WITHIN - 1.0
    observations[world, 4] = velocities[world, 0][0] / PACE
    rewards[world] = wp.exp(-wp.abs(above) / 5.0)
    if pressures[world, 0] < 0.0 or pressures[world, 0] > 2.0 * LOAD:
        terminated[world] = 1


class Altitude(Task):
    """Hold a height that is drawn for each episode, for 30 s.

    Args:
        rate: steps a second; 96 gives steps of 32 substeps.
    """

    actions, observations, most_steps = 1, 5, 600
    observation_limits = (50.0, 50.0, 10.0, 10.0, 50.0)

    def __init__(self, rate: int = 20):
        self.rate, self.most_steps = rate, 30 * rate

    def scene(self) -> Scene:
        """Return a balloon that floats at 50 m above 18 km, in air that thins and wind that grows with height."""
        mesh, rate = envelope(), GAS_CONSTANT * TEMPERATURE
        self.amount = (PRESSURE + START_PRESSURE) * VOLUME / rate
        self.helium = self.amount - BALLAST
        gas_mass = self.helium * HELIUM_MOLAR_MASS + BALLAST * DRY_AIR_MOLAR_MASS
        lift = DRY_AIR_MOLAR_MASS * PRESSURE / rate * (VOLUME + COMPLIANCE * START_PRESSURE)
        gas = Inflation(
            kind="gas",
            amount=self.amount,
            molar_mass=gas_mass / self.amount,
        )
        return Scene(
            balloon=[
                Balloon(
                    mesh=mesh,
                    position=(0.0, MIDDLE, 0.0),
                    material=stiff_film(lift * THIN - gas_mass, mesh),
                    inflation=gas,
                    damping=0.0,
                    drag_coefficient=0.47,
                )
            ],
            atmosphere=Atmosphere(
                pressure=PRESSURE, temperature=TEMPERATURE, lapse=0.0, wind=(5.0, 0.0, 0.0), shear=0.5, wind_height=50.0
            ),
            gravity=GRAVITY,
            frames_per_second=self.rate,
            touch=False,
        )

    def begin(self, simulator: Simulator) -> None:
        """Control pump and molar mass, and draw the goal and the wind."""
        controls, seen, starts = simulator.controls, simulator.observations, simulator.starts
        self._device, self._worlds = simulator.model.device, simulator.model.world_count
        self._written = [
            controls.open("balloon.inflation.pump", -MOST_PUMP, MOST_PUMP),
            controls.open("balloon.inflation.molar_mass", HELIUM_MOLAR_MASS, DRY_AIR_MOLAR_MASS),
        ]
        names = ("centers", "velocities", "pressures", "gas_amounts")
        self._seen = [seen[name] for name in names]
        self._goals = starts.value("goal", MIDDLE - HEIGHT, MIDDLE + HEIGHT)
        starts.draw("atmosphere.wind.0", -5.0, 5.0)

    def act(self, actions: wp.array) -> None:
        """Pump air in or out."""
        inputs = [actions, self._seen[3], self.helium]
        launch(pump_air, self._worlds, inputs, self._written, device=self._device)

    def judge(self, observations: wp.array, rewards: wp.array, terminated: wp.array) -> None:
        """See height above the goal and its rate, superpressure, air within, and how fast it drifts."""
        inputs = [*self._seen, self.helium, self._goals]
        launch(judge_height, self._worlds, inputs, [observations, rewards, terminated], device=self._device)

    @staticmethod
    def policy(observations: NDArray[Any]) -> NDArray[Any]:
        """Aim at a ballast that grows with height and its rate, and pump towards it."""
        ballast = np.clip(2.0 * observations[:, :1] + 3.0 * observations[:, 1:2], -0.9, 0.9)
        return np.clip(5.0 * (ballast - observations[:, 3:4]), -1.0, 1.0)

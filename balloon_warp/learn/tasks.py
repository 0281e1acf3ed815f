"""Tasks: the base class, and `Altitude`, `Inflate`, `Juggle`, `Press` and `Target`.

Each has a scene, a kernel that turns actions into controls, and one for observations and rewards. `Altitude` is as in
the Balloon Learning Environment (Bellemare et al. 2020, Autonomous navigation of stratospheric balloons using
reinforcement learning): helium lifts, and air that is pumped in is ballast. Here the film itself is simulated.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.laws import Law, Parameter
from balloon_warp.kernels.laws.air import DRY_AIR_MOLAR_MASS, GAS_CONSTANT
from balloon_warp.laws import particle_law
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import quad_sphere, signed_volume, total_area
from balloon_warp.scene import Atmosphere, Balloon, Ground, Inflation, Material, Obstacle, Scene, Stiffness
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_threads import launch


class Task(ABC):
    """A task of an environment. Copy one of this file, and change it.

    Its kernels have a thread a world. They run on the device of the simulator, and nothing passes the host.
    """

    actions: ClassVar[int]
    """Number of actions, each from -1 to 1"""
    observations: ClassVar[int]
    """Number of observations"""
    observation_limits: ClassVar[float | tuple[float, ...]] = float("inf")
    """Largest magnitude of the observations, one for all or one for each, to which they are clipped"""
    most_steps: int
    """Number of steps after which an episode is truncated"""
    frames: ClassVar[int] = 1
    """Number of frames in a step"""

    @abstractmethod
    def scene(self) -> Scene:
        """Return the scene of every world."""

    def laws(self) -> Sequence[Law]:
        """Return laws of the task's own."""
        return ()

    @abstractmethod
    def begin(self, simulator: Simulator) -> None:
        """Open the controls and observations that the task needs, and the random values of each episode."""

    @abstractmethod
    def act(self, actions: wp.array) -> None:
        """Write controls, by actions of shape (world_count, actions), float32."""

    @abstractmethod
    def judge(self, observations: wp.array, rewards: wp.array, terminated: wp.array) -> None:
        """Write observations, shape (world_count, observations), rewards, and 1 where an episode has ended."""

    @staticmethod
    @abstractmethod
    def policy(observations: NDArray[Any]) -> NDArray[Any]:
        """Return the actions of a simple policy that is known to work, from observations."""


wp.set_module_options(OPTIONS)
VOLUME, COMPLIANCE = 1804.0, 0.0199
"""Volume without superpressure [m^3], and its growth [m^3/Pa], of that environment's balloon"""
PRESSURE, TEMPERATURE = 7565.0, 216.65
"""Pressure and temperature of the air at height 0, 18 km up [Pa], [K]"""
GRAVITY, HELIUM_MOLAR_MASS = 9.81, 0.0040026
START_PRESSURE, BALLAST = 300.0, 300.0
"""Superpressure [Pa], and air within [mol], at the start"""
THICKNESS = 1.0e-4
MOST_BALLAST_PUMP = 40.0
"""Air in or out [mol/s]"""
HEIGHT_UNIT, SPEED_UNIT, SUPERPRESSURE = 10.0, 2.0, 1000.0
"""Units of the observations [m], [m/s], [Pa]"""
MIDDLE = 50.0
"""Height at the start, above 18 km [m]"""
THIN = np.exp(-DRY_AIR_MOLAR_MASS * GRAVITY * MIDDLE / (GAS_CONSTANT * TEMPERATURE))
"""Density of the air there over that at height 0"""
LENGTH, VELOCITY, SUPERPRESSURE_UNIT = wp.constant(HEIGHT_UNIT), wp.constant(SPEED_UNIT), wp.constant(SUPERPRESSURE)
AIR_WITHIN = wp.constant(BALLAST)
BALLAST_FLOW, HELIUM, AIR = (
    wp.constant(MOST_BALLAST_PUMP),
    wp.constant(HELIUM_MOLAR_MASS),
    wp.constant(DRY_AIR_MOLAR_MASS),
)


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
def pump_ballast(
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
    flow = BALLAST_FLOW * actions[world, 0]
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
    observations[world, 1] = velocities[world, 0][1] / VELOCITY
    observations[world, 2] = pressures[world, 0] / SUPERPRESSURE_UNIT
    observations[world, 3] = (float(gas_amounts[world, 0]) - helium) / AIR_WITHIN - 1.0
    observations[world, 4] = velocities[world, 0][0] / VELOCITY
    rewards[world] = wp.exp(-wp.abs(above) / 5.0)
    if pressures[world, 0] < 0.0 or pressures[world, 0] > 2.0 * SUPERPRESSURE_UNIT:
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
            controls.open("balloon.inflation.pump", -MOST_BALLAST_PUMP, MOST_BALLAST_PUMP),
            controls.open("balloon.inflation.molar_mass", HELIUM_MOLAR_MASS, DRY_AIR_MOLAR_MASS),
        ]
        names = ("centers", "velocities", "pressures", "gas_amounts")
        self._seen = [seen[name] for name in names]
        self._goals = starts.value("goal", MIDDLE - HEIGHT_UNIT, MIDDLE + HEIGHT_UNIT)
        starts.draw("atmosphere.wind.0", -5.0, 5.0)

    def act(self, actions: wp.array) -> None:
        """Pump air in or out."""
        inputs = [actions, self._seen[3], self.helium]
        launch(pump_ballast, self._worlds, inputs, self._written, device=self._device)

    def judge(self, observations: wp.array, rewards: wp.array, terminated: wp.array) -> None:
        """See height above the goal and its rate, superpressure, air within, and how fast it drifts."""
        inputs = [*self._seen, self.helium, self._goals]
        launch(judge_height, self._worlds, inputs, [observations, rewards, terminated], device=self._device)

    @staticmethod
    def policy(observations: NDArray[Any]) -> NDArray[Any]:
        """Aim at a ballast that grows with height and its rate, and pump towards it."""
        ballast = np.clip(2.0 * observations[:, :1] + 3.0 * observations[:, 1:2], -0.9, 0.9)
        return np.clip(5.0 * (ballast - observations[:, 3:4]), -1.0, 1.0)


LATEX_RADIUS = 0.05
"""Radius of the balloon at rest [m]"""
MOST_STRETCH = 2.6
"""Stretch of the skin at which the balloon bursts [1]"""
MOST_PUMP = 0.2
"""Air in or out [mol/s]"""
LEAST_GROWTH, MOST_GROWTH = 3.0, 10.0
"""Volumes that are asked for, over that at rest"""
PUMP_FLOW, LIMIT, PRESSURE_UNIT = wp.constant(MOST_PUMP), wp.constant(MOST_STRETCH), wp.constant(2000.0)


@wp.kernel
def pump_latex(actions: wp.array2d[float], pump: wp.array[float]):
    """Pump air in or out."""
    world = wp.tid()
    pump[world] = PUMP_FLOW * actions[world, 0]


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
    observations[world, 2] = pressures[world, 0] / PRESSURE_UNIT
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
                    mesh=quad_sphere(5, LATEX_RADIUS),
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
        launch(pump_latex, self._worlds, [actions], [self._pump], device=self._device)

    def judge(self, observations: wp.array, rewards: wp.array, terminated: wp.array) -> None:
        """See the logarithm of volume over goal, the volume, the pressure, and the stretch over its limit."""
        inputs = [*self._seen, self._goals, self._rest]
        launch(judge_volume, self._worlds, inputs, [observations, rewards, terminated], device=self._device)

    @staticmethod
    def policy(observations: NDArray[Any]) -> NDArray[Any]:
        """Pump in proportion to the logarithm of the missing growth."""
        return np.clip(-8.0 * observations[:, :1], -1.0, 1.0)


JUGGLED_RADIUS, PLATE_WIDTH, PLATE_THICKNESS = 0.15, 0.6, 0.2
"""Radius of the balloon, and width and thickness of the plate [m]"""
MOST_PLATE_SPEED = 2.0
"""Largest velocity of the plate along each axis [m/s]"""
HIGH, LOW = 0.5, -0.6
"""Height above which a balloon is up, and below which it is lost [m]"""
PLATE_SPEED, UP, LOST = wp.constant(MOST_PLATE_SPEED), wp.constant(HIGH), wp.constant(LOW)


@wp.kernel
def move_plate(actions: wp.array2d[float], places: wp.array2d[wp.vec3], velocities: wp.array2d[float]):
    """Move the plate, which stays within two meters of the origin."""
    world = wp.tid()
    for axis in range(3):
        place = places[world, 0][axis]
        velocity = PLATE_SPEED * actions[world, axis]
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
            mesh=quad_sphere(5, JUGGLED_RADIUS),
            position=(0.0, 0.8, 0.0),
            mass=0.02,
            inflation=Inflation(pressure=20.0),
            stiffness=Stiffness(structural=40.0, shear=20.0, flexion=5.0),
            drag_coefficient=0.47,
            damping=0.0,
        )
        plate = Obstacle(size=(PLATE_WIDTH, PLATE_THICKNESS, PLATE_WIDTH), position=(0.0, 0.0, 0.0), friction=0.8)
        return Scene(balloon=[ball], obstacle=[plate], touch=False, faces=False)

    def begin(self, simulator: Simulator) -> None:
        """Control the plate's velocity, and draw the balloon's and the wind."""
        self._worlds, self._device = simulator.model.world_count, simulator.model.device
        self._velocity = simulator.controls.open("obstacle.0.velocity", -MOST_PLATE_SPEED, MOST_PLATE_SPEED)
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
        above = center[:, 1] - plate[:, 1] - 0.5 * PLATE_THICKNESS - JUGGLED_RADIUS
        hits = (velocity[:, 1] < 0.5) & (above < 0.15)
        action[:, 1] = np.where(hits, 0.6, 2.0 * (0.1 - plate[:, 1]))
        return np.clip(action, -1.0, 1.0)


PRESSED_RADIUS, JAW_THICKNESS = 0.15, 0.04
"""Radius of the balloon, and thickness of the plates [m]"""
MOST_JAW_SPEED = 0.5
"""Largest speed of the plates [m/s]"""
MOST_PRESSURE = 900.0
"""Pressure at which the balloon bursts [Pa]; 300 at rest"""
GOAL_HEIGHT = 0.5
"""Goal for the height of the balloon's center [m]"""
NARROWEST, WIDEST, TOP = 0.04, 0.3, 1.0
"""Least and largest distance of a plate from the middle, and largest height [m]"""
JAW_SPEED, GOAL, BURSTS = wp.constant(MOST_JAW_SPEED), wp.constant(GOAL_HEIGHT), wp.constant(MOST_PRESSURE)
REST_HEIGHT = wp.constant(PRESSED_RADIUS)
LEAST, MOST, HIGHEST = wp.constant(NARROWEST), wp.constant(WIDEST), wp.constant(TOP)


@wp.kernel
def move_plates(
    actions: wp.array2d[float], places: wp.array2d[wp.vec3], left: wp.array2d[float], right: wp.array2d[float]
):
    """Close the gripper by the first action, and lift it by the second."""
    world = wp.tid()
    closing = JAW_SPEED * actions[world, 0]
    lifting = JAW_SPEED * actions[world, 1]
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
            mesh=quad_sphere(5, PRESSED_RADIUS),
            position=(0.0, PRESSED_RADIUS, 0.0),
            mass=0.03,
            inflation=Inflation(kind="gas", molar_mass=0.029, start_pressure=300.0),
            friction=0.8,
            damping=3.0,
        )
        plates = [
            Obstacle(
                size=(JAW_THICKNESS, 0.3, 0.4),
                position=(side * (WIDEST - 0.05), PRESSED_RADIUS + 0.01, 0.0),
                friction=0.8,
            )
            for side in (-1.0, 1.0)
        ]
        return Scene(balloon=[ball], obstacle=plates, ground=Ground(), touch=False, faces=False)

    def begin(self, simulator: Simulator) -> None:
        """Control both plates' velocities, and draw the balloon's mass."""
        self._worlds, self._device = simulator.model.world_count, simulator.model.device
        paths = (f"obstacle.{number}.velocity" for number in range(2))
        self._plates = [simulator.controls.open(path, -MOST_JAW_SPEED, MOST_JAW_SPEED) for path in paths]
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


DISTANCE, RING = 2.0, 0.25
"""Distance of the ring from the start, and its radius [m]"""
MOST_JET = 0.15
"""Thrust of the jet along each axis [N]; the balloon weighs 0.1 N"""
FAR, RING_RADIUS, JET = wp.constant(DISTANCE), wp.constant(RING), wp.constant(MOST_JET)


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
        rewards[world] = wp.where(wp.length(wp.vec2(way[1], way[2])) < RING_RADIUS, 10.0, 0.0)
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

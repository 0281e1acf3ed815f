"""Momentum exchange of balloons and spheres: `contact = "impulse"`, beside the paper's penalty."""

import re
from typing import Literal

import numpy as np
import pytest
from conserved import angular_momentum, energy, masses, momentum, motion, put, sphere_energies, sphere_momenta
from meshes import cube, quad_sphere
from numpy.typing import NDArray

from balloon_warp.blow_ups import Pulls
from balloon_warp.scene import Atmosphere, Balloon, Change, Ground, Inflation, Scene, Sphere, Stiffness
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

NO_SPRINGS = Stiffness(structural=0.0, shear=0.0, flexion=0.0)
NO_INFLATION = Inflation(k_normal=0.0)
EPSILON = float(np.finfo(np.float32).eps)


@pytest.fixture(params=["scatter", "gather", "lanes", "octets", "block", "projective"])
def layout(request: pytest.FixtureRequest, device: str) -> dict[str, str]:
    """Return a solver or a schedule as keyword arguments."""
    if request.param in ("lanes", "octets") and device != "cpu":
        pytest.skip(f"{request.param} is for the CPU")
    return {"solver": "projective"} if request.param == "projective" else {"schedule": request.param}


def struck(device: str, mass: float, schedule: str = "auto", balloon: dict | None = None, **fields) -> Simulator:
    """Return a balloon at rest that a sphere of this mass hits off its center at 2 m/s, in space."""
    ball = {"mesh": quad_sphere(4, radius=0.5), "mass": 0.5, "damping": 0.0, "inflation": NO_INFLATION}
    sphere = Sphere(position=(0.1, 0.9, 0.05), radius=0.3, mass=mass, velocity=(0.0, -2.0, 0.3))
    setting = {"gravity": 0.0, "contact": "impulse", "substeps": 40, "atmosphere": Atmosphere(density=0.0)}
    scene = Scene(balloon=[Balloon(**ball | (balloon or {}))], sphere=[sphere], **setting | fields)
    return Simulator(scene, device, schedule=schedule)


def whole_momentum(simulator: Simulator) -> NDArray[np.float64]:
    return momentum(simulator) + sphere_momenta(simulator).sum(axis=0)


def whole_angular_momentum(simulator: Simulator) -> NDArray[np.float64]:
    centers = simulator.state.sphere_positions.numpy()[0].astype(np.float64)
    return angular_momentum(simulator) + np.cross(centers, sphere_momenta(simulator)).sum(axis=0)


@pytest.mark.full
@pytest.mark.parametrize("mass", [0.02, 0.5, 20.0])
def test_balloon_and_sphere_together_keep_their_momentum(mass, layout, device):
    """Momentum is conserved to rounding: a substep rounds velocities of particles and sphere by up to half an epsilon;
    projective's linear system adds up to an epsilon of the balloon's momentum."""
    fields = dict(layout)
    simulator = struck(device, mass, fields.pop("schedule", "auto"), **fields)
    start, kick = whole_momentum(simulator), 0.0
    for frame in range(1, 31):
        simulator.step()
        kick = max(kick, np.abs(sphere_momenta(simulator)[0] - start).max())
        rounding = EPSILON * np.sqrt(40 * frame) * 2.0 * (mass + 0.5)
        if "solver" in layout:
            rounding += EPSILON * 40 * frame * np.abs(momentum(simulator)).max()
        assert np.abs(whole_momentum(simulator) - start).max() < rounding
    assert kick > min(mass, 0.1)


def test_gas_moves_with_the_balloon_that_a_sphere_hits(device):
    """Momentum conservation includes the gas, which is most of the balloon's mass here."""
    gas = {"mass": 0.1, "inflation": Inflation(kind="gas", start_pressure=10.0, molar_mass=0.02)}
    simulator = struck(device, 0.5, balloon=gas)
    assert masses(simulator).sum() > 0.4
    start = whole_momentum(simulator)
    for _ in range(20):
        simulator.step()
    assert np.abs(whole_momentum(simulator) - start).max() < EPSILON * np.sqrt(40 * 20) * 2.0
    assert np.abs(momentum(simulator)).max() > 0.1


def test_the_papers_penalty_keeps_no_momentum(device):
    """The paper's penalty does not conserve momentum: the sphere flies on, or feels the inflation alone."""
    simulator = struck(device, 0.5, contact="penalty")
    start = whole_momentum(simulator), energy(simulator) + sphere_energies(simulator).sum()
    for _ in range(30):
        simulator.step()
    assert np.abs(whole_momentum(simulator) - start[0]).max() > 0.3
    assert energy(simulator) + sphere_energies(simulator).sum() > 1.5 * start[1]


def test_contact_turns_and_shifts_nothing(layout, device):
    """Angular momentum is conserved and the common center of mass coasts: the impulse is along the line through both
    centers at the start of the step, and places follow velocities. Float32 rounds each place and velocity once a
    substep, by up to half an epsilon."""
    fields = dict(layout)
    simulator = struck(device, 0.5, fields.pop("schedule", "auto"), **fields)
    start = whole_angular_momentum(simulator), center_of_mass(simulator)
    for _ in range(15):
        simulator.step()
    assert np.abs(sphere_momenta(simulator)[0] - (0.0, -1.0, 0.15)).max() > 0.1
    rounding = EPSILON * np.sqrt(15 * 40)
    coasted = start[1] + 0.25 * whole_momentum(simulator) / 1.0  # for a quarter of a second, of one kilogram
    np.testing.assert_allclose(center_of_mass(simulator), coasted, atol=3.0 * rounding)
    if "solver" not in layout:  # backward Euler turns
        np.testing.assert_allclose(whole_angular_momentum(simulator), start[0], atol=3.0 * rounding)


def center_of_mass(simulator: Simulator) -> NDArray[np.float64]:
    points, _ = motion(simulator)
    sphere_mass, centers = (
        simulator.model.parameters["sphere_mass"].numpy()[0],
        simulator.state.sphere_positions.numpy()[0],
    )
    return (masses(simulator) @ points + sphere_mass @ centers) / (masses(simulator).sum() + sphere_mass.sum())


def bare_cubes(device: str, spheres: list[Sphere], cubes: int = 1, schedule: str = "auto", **fields) -> Simulator:
    """Return unit cubes without springs, inflation or damping, all at one place; a step a frame, of a millisecond."""
    still = {"mesh": cube(), "mass": 0.8, "stiffness": NO_SPRINGS, "inflation": NO_INFLATION, "damping": 0.0}
    setting = {"gravity": 0.0, "contact": "impulse", "substeps": 1, "frames_per_second": 1000.0, "faces": False}
    setting["touch"] = False  # they are in each other
    scene = Scene(balloon=[Balloon(**still)] * cubes, sphere=spheres, **setting | fields)
    return Simulator(scene, device, schedule=schedule)


@pytest.mark.parametrize("cubes", [1, 5])
def test_a_particle_closes_the_gap_and_then_moves_on_with_the_sphere(cubes, device):
    """A corner of 0.1 kg that comes at 4 m/s over a gap of a millimeter closes it in a step, at 1 m/s. With the sphere
    of 2.4 kg it then has 0.16 m/s: it moves at 1 m/s beside it in one step, 0 in the next. Other balloons do not
    matter."""
    corner = cube().points[6]
    sphere = Sphere(position=tuple(corner + [0.1, 0.0, 0.0]), radius=0.099, mass=2.4)
    simulator = bare_cubes(device, [sphere], cubes)
    velocities = np.zeros((8 * cubes, 3))
    velocities[6] = [4.0, 0.0, 0.0]
    for other in range(1, cubes):
        velocities[8 * other : 8 * other + 8, 1] = -100.0  # away at once
    put(simulator, velocities=velocities)
    for beside in (1.0, 0.0):
        simulator.step()
        of_particle, of_sphere = motion(simulator)[1][6], simulator.state.sphere_velocities.numpy()[0, 0]
        np.testing.assert_allclose(of_particle, [0.16 + beside * 2.4 / 2.5, 0.0, 0.0], atol=1e-3)  # a gap's rounding
        np.testing.assert_allclose(of_sphere, [0.16 - beside * 0.1 / 2.5, 0.0, 0.0], atol=1e-3)
        np.testing.assert_allclose(0.1 * of_particle + 2.4 * of_sphere, [0.4, 0.0, 0.0], atol=1e-6)
    gap = np.linalg.norm(simulator.state.sphere_positions.numpy()[0, 0] - motion(simulator)[0][6]) - 0.099
    np.testing.assert_allclose(gap, 0.0, atol=1e-6)


@pytest.mark.parametrize("sphere_mass", [0.024, 1.2, 240.0])
def test_balloons_that_touch_all_over_stick_to_the_sphere(sphere_mass, device):
    """Three cubes against a sphere almost as flat as a wall go on at the mean of their speeds by mass, and the sphere
    does not turn back, however light. The corners see it under up to 0.7 / 29 from the middle."""
    wall = Sphere(position=(-28.9, 0.5, 0.5), radius=30.0, mass=sphere_mass)
    simulator = bare_cubes(device, [wall], cubes=3)
    put(simulator, velocities=np.tile([-2.0, 0.0, 0.0], (24, 1)))
    simulator.step()
    together = -2.0 * 2.4 / (2.4 + sphere_mass)
    velocities = motion(simulator)[1]
    np.testing.assert_allclose(velocities[:, 0], together, atol=2.0 * 0.025**2)
    np.testing.assert_allclose(velocities[:, 1:], 0.0, atol=2.0 * 0.025)
    np.testing.assert_allclose(sphere_momenta(simulator)[0] / sphere_mass, [together, 0.0, 0.0], atol=2.0 * 0.025**2)


@pytest.mark.full
def test_a_balloon_carries_a_sphere(device):
    """A balloon bears a sphere's weight to a thousandth once it has come to rest; by the paper's penalty it gives way
    to a sphere so heavy for the inflation."""
    stiff = Stiffness(structural=200.0, shear=100.0, flexion=100.0, viscosity=0.01)
    inflation = Inflation(k_normal=0.2)
    balloon = Balloon(
        mesh=quad_sphere(4, 0.5), position=(0.0, 0.5, 0.0), mass=0.5, damping=3.0, stiffness=stiff, inflation=inflation
    )
    sphere = Sphere(position=(0.0, 1.15, 0.0), radius=0.3, mass=0.4)
    heights, pushes = {}, {}
    for contact in ("impulse", "penalty"):
        simulator = Simulator(
            Scene(balloon=[balloon], sphere=[sphere], ground=Ground(), contact=contact, normals="cached"), device
        )
        for _ in range(180):
            simulator.step()
        heights[contact] = float(simulator.state.sphere_positions.numpy()[0, 0, 1])
        pushes[contact] = simulator.state.sphere_forces.numpy()[0, 0]
    assert heights["impulse"] > 1.05
    np.testing.assert_allclose(pushes["impulse"], [0.0, 0.4 * 9.81, 0.0], atol=4e-3)
    assert heights["penalty"] < 0.5


def test_a_diagnosis_names_all_touching_particles(device):
    """The report names all touching particles, each with its share of the push; none while the sphere is free."""
    simulator = struck(device, 0.5)
    assert Pulls(simulator.model, simulator.state, 0.0).contact_at(0, newtons=0.0) is None
    for _ in range(5):
        simulator.step()
    push = Pulls(simulator.model, simulator.state, 0.0).contact_at(0, newtons=3.0)
    assert re.fullmatch(r"\d+ particles in contact with it pushed it with 3 N", str(push))


@pytest.mark.parametrize("schedule", ["auto", "scatter"])
def test_the_rule_may_change_meanwhile(schedule: Literal["auto", "scatter"], device):
    """The contact rule may change during a run: a sphere that flies through by one is stopped by the other."""
    change = [Change(time=0.05, set={"contact": "impulse"})]
    speeds = []
    for changes in ([], change):
        simulator = struck(device, 0.5, schedule, contact="penalty", change=changes)
        for _ in range(20):
            simulator.step()
        speeds.append(-simulator.state.sphere_velocities.numpy()[0, 0, 1])
    assert speeds[0] == pytest.approx(2.0)
    assert speeds[1] < 1.9

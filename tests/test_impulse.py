"""Balloons and spheres that exchange momentum: `contact = "impulse"`, beside the paper's penalty."""

import re
from typing import Literal

import numpy as np
import pytest
from conserved import angular_momentum, energy, masses, momentum, motion, put, sphere_momenta
from meshes import cube, quad_sphere
from numpy.typing import NDArray

from balloon_warp.blow_ups import Pulls
from balloon_warp.scene import Atmosphere, Balloon, Change, Ground, Inflation, Scene, Sphere, Stiffness
from balloon_warp.simulator import Simulator

NO_SPRINGS = Stiffness(structural=0.0, shear=0.0, flexion=0.0)
NO_INFLATION = Inflation(k_normal=0.0)
EPSILON = float(np.finfo(np.float32).eps)


@pytest.fixture(params=["scatter", "gather", "lanes", "octets", "block", "projective"])
def layout(request: pytest.FixtureRequest, device: str) -> dict[str, str]:
    """A solver, or a schedule."""
    if request.param in ("lanes", "octets") and device != "cpu":
        pytest.skip(f"{request.param} is for the CPU")
    return {"solver": "projective"} if request.param == "projective" else {"schedule": request.param}


def struck(device: str, mass: float, schedule: str = "auto", balloon: dict | None = None, **fields) -> Simulator:
    """A balloon at rest that a sphere of this mass hits off its center at 2 m/s, in space."""
    ball = {"mesh": quad_sphere(4, radius=0.5), "mass": 0.5, "damping": 0.0, "inflation": NO_INFLATION}
    sphere = Sphere(position=(0.1, 0.9, 0.05), radius=0.3, mass=mass, velocity=(0.0, -2.0, 0.3))
    setting = {"gravity": 0.0, "contact": "impulse", "substeps": 40, "atmosphere": Atmosphere(density=0.0)}
    scene = Scene(balloon=[Balloon(**ball | (balloon or {}))], sphere=[sphere], **setting | fields)
    return Simulator(scene, device, schedule=schedule)


def sphere_energy(simulator: Simulator) -> float:
    """Of the first sphere's motion [J], with what it gets when it next moves."""
    return float(
        (sphere_momenta(simulator)[0] ** 2).sum() / (2.0 * simulator.model.parameters["sphere_mass"].numpy()[0, 0])
    )


def whole_momentum(simulator: Simulator) -> NDArray[np.float64]:
    return momentum(simulator) + sphere_momenta(simulator).sum(axis=0)


def whole_angular_momentum(simulator: Simulator) -> NDArray[np.float64]:
    centers = simulator.state.sphere_positions.numpy()[0].astype(np.float64)
    return angular_momentum(simulator) + np.cross(centers, sphere_momenta(simulator)).sum(axis=0)


@pytest.mark.parametrize("mass", [0.02, 0.5, 20.0])
def test_balloon_and_sphere_together_keep_their_momentum(mass, layout, device):
    """A substep rounds the velocities of particles and sphere by up to half an epsilon to either side; projective's
    linear system adds up to an epsilon of the balloon's momentum."""
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
    """Its mass counts, and it is most of the balloon's here."""
    gas = {"mass": 0.1, "inflation": Inflation(kind="gas", start_pressure=10.0, molar_mass=0.02)}
    simulator = struck(device, 0.5, balloon=gas)
    assert masses(simulator).sum() > 0.4
    start = whole_momentum(simulator)
    for _ in range(20):
        simulator.step()
    assert np.abs(whole_momentum(simulator) - start).max() < EPSILON * np.sqrt(40 * 20) * 2.0
    assert np.abs(momentum(simulator)).max() > 0.1


def test_the_papers_penalty_keeps_no_momentum(device):
    """The balloon is pushed away and the sphere flies on, or feels the inflation and nothing else."""
    simulator = struck(device, 0.5, contact="penalty")
    start = whole_momentum(simulator), energy(simulator) + sphere_energy(simulator)
    for _ in range(30):
        simulator.step()
    assert np.abs(whole_momentum(simulator) - start[0]).max() > 0.3
    assert energy(simulator) + sphere_energy(simulator) > 1.5 * start[1]


@pytest.mark.parametrize("mass", [0.02, 0.5, 20.0])
def test_a_collision_takes_energy_away(mass, device):
    """Of springs and motion; symplectic Euler's swings by some thousandths."""
    simulator = struck(device, mass)
    start = sphere_energy(simulator)
    for _ in range(30):
        simulator.step()
        assert energy(simulator) + sphere_energy(simulator) < 1.01 * start
    assert energy(simulator) + sphere_energy(simulator) < 0.999 * start
    assert energy(simulator) > 1e-3 * start


def test_moving_particles_out_turns_and_shifts_at_first_order_of_the_step(device):
    """A particle that moves out of a sphere has not got there by its momentum. How deep it came goes with the step."""
    turned, shifted = [], []
    for substeps in (20, 40, 80):
        simulator = struck(device, 0.5, substeps=substeps)
        start = whole_angular_momentum(simulator), _center_of_mass(simulator)
        for _ in range(15):
            simulator.step()
        turned.append(np.linalg.norm(whole_angular_momentum(simulator) - start[0]))
        coasted = start[1] + 0.25 * whole_momentum(simulator) / 1.0  # for a quarter of a second, of one kilogram
        shifted.append(np.linalg.norm(_center_of_mass(simulator) - coasted))
    for errors in (turned, shifted):
        np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 1.0, atol=0.5)


def _center_of_mass(simulator: Simulator) -> NDArray[np.float64]:
    points, _ = motion(simulator)
    sphere_mass, centers = (
        simulator.model.parameters["sphere_mass"].numpy()[0],
        simulator.state.sphere_positions.numpy()[0],
    )
    return (masses(simulator) @ points + sphere_mass @ centers) / (masses(simulator).sum() + sphere_mass.sum())


def bare_cubes(device: str, spheres: list[Sphere], cubes: int = 1, schedule: str = "auto", **fields) -> Simulator:
    """Unit cubes without springs, inflation or damping, all at one place; a step a frame, of a millisecond."""
    still = {"mesh": cube(), "mass": 0.8, "stiffness": NO_SPRINGS, "inflation": NO_INFLATION, "damping": 0.0}
    setting = {"gravity": 0.0, "contact": "impulse", "substeps": 1, "frames_per_second": 1000.0}
    scene = Scene(balloon=[Balloon(**still)] * cubes, sphere=spheres, **setting | fields)
    return Simulator(scene, device, schedule=schedule)


def test_a_particle_hits_its_share_of_the_sphere(device):
    """A corner of 0.1 kg, an eighth of the cube, against an eighth of 2.4 kg: after the plastic collision both move at
    the mean of their speeds by mass, 1/4 of the corner's, and the sphere, in the next step, at an eighth of that."""
    corner = cube().points[6]
    simulator = bare_cubes(device, [Sphere(position=tuple(corner + [0.1, 0.0, 0.0]), radius=0.12, mass=2.4)])
    velocities = np.zeros((8, 3))
    velocities[6] = [4.0, 0.0, 0.0]
    put(simulator, velocities=velocities)
    simulator.step()
    np.testing.assert_allclose(motion(simulator)[1][6], [1.0, 0.0, 0.0], atol=1e-5)  # the direction is rounded, too
    np.testing.assert_array_equal(simulator.state.sphere_velocities.numpy()[0], 0.0)
    simulator.step()
    np.testing.assert_allclose(simulator.state.sphere_velocities.numpy()[0, 0], [0.125, 0.0, 0.0], atol=1e-6)


@pytest.mark.parametrize("sphere_mass", [0.024, 1.2, 240.0])
def test_balloons_that_touch_all_over_stick_to_the_sphere(sphere_mass, device):
    """Three cubes against a sphere almost as flat as a wall: all go on at the mean of their speeds by mass, and the
    sphere does not turn back, however light. The corners see it under up to 0.7 / 29 from the middle."""
    wall = Sphere(position=(-28.9, 0.5, 0.5), radius=30.0, mass=sphere_mass)
    simulator = bare_cubes(device, [wall], cubes=3)
    put(simulator, velocities=np.tile([-2.0, 0.0, 0.0], (24, 1)))
    simulator.step()
    together = -2.0 * 2.4 / (2.4 + sphere_mass)
    velocities = motion(simulator)[1]
    np.testing.assert_allclose(velocities[:, 0], together, atol=2.0 * 0.025**2)
    np.testing.assert_allclose(velocities[:, 1:], 0.0, atol=2.0 * 0.025)
    np.testing.assert_allclose(sphere_momenta(simulator)[0] / sphere_mass, [together, 0.0, 0.0], atol=2.0 * 0.025**2)


@pytest.mark.parametrize("sphere_mass", [0.01, 1.0, 100.0])
def test_kinetic_energy_never_grows_by_contact(sphere_mass, device):
    """All the corners of three cubes at once, at random velocities, between two spheres that hold them both."""
    spheres = [
        Sphere(position=(x, 0.5, 0.5), radius=1.5, mass=sphere_mass, velocity=(-5.0 * x, 1.0, 0.0)) for x in (0.4, 0.6)
    ]
    simulator = bare_cubes(device, spheres, cubes=3)
    random = np.random.default_rng(5)
    put(simulator, velocities=random.normal(scale=3.0, size=(24, 3)))

    def kinetic_energy() -> float:
        _, velocities = motion(simulator)
        of_spheres = (sphere_momenta(simulator) ** 2).sum() / (2.0 * sphere_mass)
        return float(0.5 * masses(simulator) @ (velocities**2).sum(axis=1) + of_spheres)

    found = [kinetic_energy()]
    for _ in range(50):
        simulator.step()
        found.append(kinetic_energy())
    assert (np.diff(found) < 10.0 * EPSILON * found[0]).all()
    assert found[1] < 0.999 * found[0]


def test_a_balloon_carries_a_sphere(device):
    """Once it has stopped swinging, to a thousandth of its weight. The paper's penalty gives way to a sphere so heavy
    for the inflation."""
    stiff = Stiffness(structural=200.0, shear=100.0, flexion=100.0, viscosity=0.01)
    balloon = Balloon(mesh=quad_sphere(4, radius=0.5), position=(0.0, 0.5, 0.0), mass=0.5, damping=3.0, stiffness=stiff)
    sphere = Sphere(position=(0.0, 1.15, 0.0), radius=0.3, mass=0.4)
    heights, pushes = {}, {}
    for contact in ("impulse", "penalty"):
        simulator = Simulator(Scene(balloon=[balloon], sphere=[sphere], ground=Ground(), contact=contact), device)
        for _ in range(180):
            simulator.step()
        heights[contact] = float(simulator.state.sphere_positions.numpy()[0, 0, 1])
        pushes[contact] = simulator.state.sphere_forces.numpy()[0, 0]
    assert heights["impulse"] > 1.05
    np.testing.assert_allclose(pushes["impulse"], [0.0, 0.4 * 9.81, 0.0], atol=4e-3)
    assert heights["penalty"] < 0.5


def test_another_number_of_substeps_takes_nothing_of_a_momentum_on_its_way(device):
    simulator = struck(device, 0.5, change=[Change(time=5 / 60, set={"substeps": 400})])
    for _ in range(5):
        simulator.step()
    before, pending = whole_momentum(simulator), simulator.model.step_seconds * simulator.state.sphere_forces.numpy()
    simulator.step()
    assert simulator.model.substeps == 400
    assert np.abs(pending).max() > 1e-4
    np.testing.assert_allclose(whole_momentum(simulator), before, atol=EPSILON * np.sqrt(400) * 2.0)


def test_a_diagnosis_names_all_touching_particles(device):
    """Not one of them, since each has its share in the push; and nothing while the sphere is free."""
    simulator = struck(device, 0.5)
    assert Pulls(simulator.model, simulator.state, 0.0).contact_at(0, newtons=0.0) is None
    for _ in range(5):
        simulator.step()
    push = Pulls(simulator.model, simulator.state, 0.0).contact_at(0, newtons=3.0)
    assert re.fullmatch(r"what was in contact with it, \d+ particles, pushed it with 3 N", str(push))


@pytest.mark.parametrize("schedule", ["auto", "scatter"])
def test_the_rule_may_change_meanwhile(schedule: Literal["auto", "scatter"], device):
    """A sphere that flies through by the one is stopped by the other."""
    change = [Change(time=0.05, set={"contact": "impulse"})]
    speeds = []
    for changes in ([], change):
        simulator = struck(device, 0.5, schedule, contact="penalty", change=changes)
        for _ in range(20):
            simulator.step()
        speeds.append(-simulator.state.sphere_velocities.numpy()[0, 0, 1])
    assert speeds[0] == pytest.approx(2.0)
    assert speeds[1] < 1.9

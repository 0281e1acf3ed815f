"""Friction and spin of spheres, by Coulomb's law and a solid ball's inertia."""

import numpy as np
import pytest
from conserved import angular_momentum, energy, momentum, motion, put, sphere_energies, sphere_momenta
from meshes import quad_sphere
from numpy.typing import NDArray
from test_collision import after, billiard, cloud

from balloon_warp.errors import InputError
from balloon_warp.scene import (
    Atmosphere,
    Balloon,
    Body,
    Ground,
    Inflation,
    Obstacle,
    Scene,
    Sphere,
    Stiffness,
    Touch,
    load_scene,
)
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

EPSILON = float(np.finfo(np.float32).eps)
G = 9.81


def spins(simulator: Simulator) -> NDArray[np.float64]:
    """Return the spins [rad/s], shape (sphere_count, 3)."""
    return simulator.state.sphere_spins.numpy()[0].astype(np.float64)


def inertias(simulator: Simulator) -> NDArray[np.float64]:
    """Return the inertias 2/5 M R^2 [kg m^2], shape (sphere_count, 1)."""
    mass, radius = (simulator.model.parameters[f"sphere_{name}"].numpy()[0, :, None] for name in ("mass", "radius"))
    return 0.4 * mass.astype(np.float64) * radius.astype(np.float64) ** 2


def turning(simulator: Simulator) -> NDArray[np.float64]:
    """Return the angular momentum of all spheres about the origin [kg m^2/s], shape (3,)."""
    centers = simulator.state.sphere_positions.numpy()[0].astype(np.float64)
    return (np.cross(centers, sphere_momenta(simulator)) + inertias(simulator) * spins(simulator)).sum(axis=0)


def moving(simulator: Simulator) -> float:
    """Return the energy of the spheres' motion and spin [J]."""
    return float(sphere_energies(simulator).sum() + 0.5 * (inertias(simulator) * spins(simulator) ** 2).sum())


WAYS = {
    "gather": {"schedule": "gather", "contact": "impulse"},
    "octets": {"schedule": "octets", "contact": "impulse"},
    "octets, penalty": {"schedule": "octets", "contact": "penalty"},
    "block": {"schedule": "block", "contact": "impulse"},
    "block, penalty": {"schedule": "block", "contact": "penalty"},
    "projective": {"solver": "projective", "contact": "impulse"},
}
ANGLE = 0.5


@pytest.mark.full
@pytest.mark.parametrize("way", WAYS)
def test_it_slides_slower_until_it_rolls(way, device):
    """A sphere slides until it rolls. On the ground with 0.2, the root of 0.1 and 0.4, it slows down by 0.2 g, while
    the spin grows by 5/2 of that over the radius; at 5/7 of its speed it rolls. One without friction slides on. With
    spin backwards, 4 v / R, one comes back at (5 - 8) / 7 v. Down a slope it rolls with 5/7 g sin where friction is at
    least 2/7 tan, else it slides with g (sin - friction cos)."""
    if WAYS[way].get("schedule") in ("lanes", "octets") and device != "cpu":
        pytest.skip("for the CPU")
    normal = np.array([np.sin(ANGLE), np.cos(ANGLE), 0.0])
    box = Obstacle(
        size=(4, 1, 8), position=(0, 50, 0), rotation=(0, 0, -np.degrees(ANGLE)), friction=1.0, restitution=0.0
    )
    balls = [
        Sphere(position=(0, 0.1, z), radius=0.1, velocity=(1.0, 0.0, 0.0), friction=friction, angular_velocity=spin)
        for z, friction, spin in ((0, 0.1, (0, 0, 0)), (1, 0.0, (0, 0, 0)), (2, 0.1, (0, 0, 40.0)))
    ] + [
        Sphere(position=tuple((0, 50, z) + 0.6001 * normal), radius=0.1, friction=friction)
        for z, friction in ((-1, 0.25), (1, 0.01))
    ]
    ground = Ground(friction=0.4, restitution=0.0)
    simulator = billiard(device, balls, gravity=G, ground=ground, obstacle=[box], **WAYS[way])
    _, velocities = after(simulator, 10)
    expected = 1.0 - 0.2 * G * 0.1
    np.testing.assert_allclose(velocities[:3, 0], (expected, 1.0, expected), rtol=100 * EPSILON)
    turned = (-0.5 * G, 0.0, 40.0 - 0.5 * G)
    np.testing.assert_allclose(spins(simulator)[:3, 2], turned, rtol=200 * EPSILON)
    _, later = after(simulator, 20)
    gained = (later - velocities)[3:] @ (np.cos(ANGLE), -np.sin(ANGLE), 0.0) / 0.2
    rolls, slides = 5 / 7 * np.sin(ANGLE) * G, (np.sin(ANGLE) - 0.1 * np.cos(ANGLE)) * G
    np.testing.assert_allclose(gained, (rolls, slides), rtol=1e-3)  # rounding decides how often each is pushed
    _, velocities = after(simulator, 100)
    np.testing.assert_allclose(velocities[:3, 0], (5 / 7, 1.0, -3 / 7), rtol=2e-4)  # and the rounding of 1,300 steps
    np.testing.assert_allclose(spins(simulator)[:3, 2], (-50 / 7, 0.0, 30 / 7), rtol=2e-4)


@pytest.mark.full
@pytest.mark.parametrize("way", ["gather", "octets", "block", "projective"])
def test_two_that_meet_turn_each_other(way, device):
    """Friction of two equal inelastic spheres that collide at an angle changes each by a seventh of the sliding speed,
    v sin, where the coefficient is high enough; or by its share of the push, v cos / 2. Two separate pairs."""
    if way == "octets" and device != "cpu":
        pytest.skip("for the CPU")
    angle, speed, balls = 0.6, 3.0, []
    for z, friction in ((-5, 1.0), (5, 0.1)):
        alike = {"radius": 0.15, "mass": 2.0, "restitution": 0.0, "friction": friction}
        balls += [
            Sphere(position=(-0.8, -0.3 * np.sin(angle), z), velocity=(speed, 0, 0), **alike),
            Sphere(position=(0, 0, z), **alike),
        ]
    simulator = billiard(device, balls, **WAYS[way])
    turn = turning(simulator)
    _, velocities = after(simulator, 60)
    along, across = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([np.sin(angle), -np.cos(angle), 0.0])
    push = 0.5 * speed * np.cos(angle)
    rubs = np.array([min(speed * np.sin(angle) / 7.0, friction * push) for friction in (1.0, 0.1)])
    atol = 3.0 * 200 * EPSILON / 0.3  # as in test_collision
    np.testing.assert_allclose(velocities[1::2], push * along + rubs[:, None] * across, atol=atol)
    np.testing.assert_allclose(velocities[::2] + velocities[1::2], [(speed, 0, 0)] * 2, atol=atol)
    np.testing.assert_allclose(np.abs(spins(simulator)[:, 2]), np.repeat(2.5 * rubs / 0.15, 2), atol=20 * atol)
    np.testing.assert_allclose(turning(simulator), turn, atol=60 * atol)  # five meters from the origin


@pytest.mark.full
def test_a_cloud_keeps_momentum_and_angular_momentum_and_gains_no_energy(device):
    balls = [ball.model_copy(update={"friction": 0.5}) for ball in cloud(3)]
    simulator = billiard(device, balls)
    start, turn, energy_before = sphere_momenta(simulator).sum(axis=0), turning(simulator), moving(simulator)
    size = np.abs(sphere_momenta(simulator)).sum()
    for _ in range(100):
        after(simulator, 1)
        np.testing.assert_allclose(sphere_momenta(simulator).sum(axis=0), start, atol=30 * EPSILON * size)
        np.testing.assert_allclose(turning(simulator), turn, atol=400 * EPSILON * size)
        assert moving(simulator) < energy_before * (1.0 + 30 * EPSILON)
        energy_before = min(energy_before, moving(simulator))
    assert np.abs(spins(simulator)).max() > 1.0


def beside(sphere: Sphere, **fields) -> Scene:
    """Return a slack balloon of 386 particles in space, and a sphere."""
    ball = Balloon(mesh=quad_sphere(8, 0.5), mass=0.3, damping=0.0, inflation=Inflation(pressure=0.0))
    setting = {"gravity": 0.0, "atmosphere": Atmosphere(density=0.0), "contact": "impulse", "substeps": 60}
    return Scene(balloon=[ball], sphere=[sphere], **setting | fields)


TOUCHING = {
    "particles": (Sphere(position=(0.75, 0.2, 0.05), radius=0.15, mass=0.2, velocity=(-2.0, 1.0, 0.4)), {}),
    "faces": (Sphere(position=(0.6, 0.2, 0.05), radius=0.02, mass=0.05, velocity=(-2.0, 1.0, 0.4)), {"touch": Touch()}),
}


@pytest.mark.parametrize("friction", [0.3, 5.0])
@pytest.mark.parametrize(
    ("what", "schedule"),
    [*(("particles", schedule) for schedule in ("gather", "lanes", "octets", "block")), ("faces", "scatter")],
)
def test_a_balloon_turns_it_and_both_keep_momentum_and_angular_momentum(friction, what, schedule, device):
    """Momentum and angular momentum are conserved as a balloon spins a sphere, and energy does not grow: springs swing
    by h omega / 2 of what is in the fastest. Rounding is that of test_faces."""
    if schedule in ("lanes", "octets") and device != "cpu":
        pytest.skip(f"{schedule} is for the CPU")
    ball, fields = TOUCHING[what]
    scene = beside(ball.model_copy(update={"friction": friction}), **fields)
    simulator = Simulator(scene, device, schedule=schedule)

    def whole() -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        return (
            momentum(simulator) + sphere_momenta(simulator)[0],
            angular_momentum(simulator) + turning(simulator),
            energy(simulator) + moving(simulator),
        )

    start = whole()
    for _ in range(15):
        simulator.step()
        now = whole()
        rounding = 0.35 * 2.4 * EPSILON * np.sqrt(15 * 60) * 4.0
        np.testing.assert_allclose(now[0], start[0], atol=rounding)
        np.testing.assert_allclose(now[1], start[1], atol=rounding)
        assert now[2] < 1.001 * start[2]
    assert np.abs(spins(simulator)).max() > 0.5
    assert np.abs(sphere_momenta(simulator)[0] / ball.mass - ball.velocity).max() > 0.1


@pytest.mark.full
def test_many_that_rub_at_once_give_no_energy(device):
    """Friction of many contacts at once adds no energy: a swarm of particles, 30 times the mass of the sphere, comes
    down on it from all around and turns about it; each by itself would turn it many times too fast."""
    scene = beside(Sphere(position=(0, 0, 0), radius=0.499, mass=0.01, friction=5.0))
    loose = Stiffness(structural=0.0, shear=0.0, flexion=0.0)
    scene = scene.model_copy(update={"balloon": [scene.balloon[0].model_copy(update={"stiffness": loose})]})
    simulator = Simulator(scene, device, schedule="gather")
    points, _ = motion(simulator)
    put(simulator, velocities=-2.0 * points + np.cross((0.0, 0.0, 3.0), points))
    before = energy(simulator)
    simulator.step()
    assert energy(simulator) + moving(simulator) < before
    assert 1.0 < spins(simulator)[0, 2] < 3.0 + 1e-3
    np.testing.assert_allclose(sphere_momenta(simulator)[0], 0.0, atol=1e-4)


@pytest.mark.full
def test_a_free_body_turns_it(device):
    """Momentum and angular momentum are conserved as a sphere lands on the end of a free box; energy falls."""
    box = Body(shape="box", size=(0.4, 0.1, 0.3), mass=0.5, friction=0.8)
    ball = Sphere(position=(0.12, 0.3, 0.02), radius=0.1, mass=0.3, velocity=(-1.0, -2.0, 0.3), friction=0.8)
    away = Balloon(mesh=quad_sphere(2, 0.5), position=(0, 0, 90.0), inflation=Inflation(pressure=0.0))
    scene = Scene(balloon=[away], body=[box], sphere=[ball], gravity=0.0, contact="impulse", substeps=60)
    simulator = Simulator(scene, device)

    def whole() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        state = simulator.state
        velocity, place, twist = (
            array.numpy()[0, 0].astype(np.float64)
            for array in (state.body_velocities, state.body_positions, state.body_momenta)
        )
        return sphere_momenta(simulator)[0] + 0.5 * velocity, turning(simulator) + np.cross(
            place, 0.5 * velocity
        ) + twist

    start, before = whole(), moving(simulator)
    for _ in range(12):
        simulator.step()
        for now, then in zip(whole(), start, strict=True):
            np.testing.assert_allclose(now, then, atol=2e-6)
    assert moving(simulator) < before
    assert np.abs(spins(simulator)).max() > 1.0


@pytest.mark.full
def test_it_may_differ_between_worlds_change_and_must_not_be_negative(device):
    ball = Sphere(position=(0, 0.1, 0), radius=0.1, velocity=(1.0, 0.0, 0.0))
    scene = billiard(
        device, [ball], gravity=G, ground=Ground(friction=0.2, restitution=0.0), contact="impulse"
    ).model.scene
    simulator = Simulator(scene, device, 2, {"sphere.0.friction": [0.0, 0.2]})
    after(simulator, 10)
    slowed = simulator.state.sphere_velocities.numpy()[:, 0, 0]
    np.testing.assert_allclose(slowed, (1.0, 1.0 - 0.2 * G * 0.1), rtol=100 * EPSILON)
    with pytest.raises(InputError, match=r"sphere\.0\.friction: must be greater than or equal to 0 \(got -1\.0\)"):
        load_scene(scene, {"sphere.0.friction": -1.0})

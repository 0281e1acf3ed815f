"""Spheres that collide with spheres: two bodies exchange momentum along the line through their centers."""

import numpy as np
import pytest
from conserved import sphere_energies, sphere_momenta
from meshes import cube
from numpy.typing import NDArray

from balloon_warp.scene import Balloon, Ground, Inflation, Obstacle, Scene, Sphere, Stiffness
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

EPSILON = float(np.finfo(np.float32).eps)
NO_SPRINGS = Stiffness(structural=0.0, shear=0.0, flexion=0.0)


@pytest.fixture(params=["scatter", "gather", "lanes", "octets", "block", "projective"])
def layout(request: pytest.FixtureRequest, device: str) -> dict[str, str]:
    """Return a solver or a schedule as keyword arguments."""
    if request.param in ("lanes", "octets") and device != "cpu":
        pytest.skip(f"{request.param} is for the CPU")
    return {"solver": "projective"} if request.param == "projective" else {"schedule": request.param}


def billiard(device: str, spheres: list[Sphere], schedule: str = "auto", **fields) -> Simulator:
    """Return spheres in space, with a balloon far away; 10 steps a frame of a hundredth of a second."""
    away = Balloon(mesh=cube(), position=(0, 0, 900.0), stiffness=NO_SPRINGS, inflation=Inflation(k_normal=0.0))
    setting = {"gravity": 0.0, "frames_per_second": 100.0, "substeps": 10}
    return Simulator(Scene(balloon=[away], sphere=spheres, **setting | fields), device, schedule=schedule)


def after(simulator: Simulator, frames: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return centers and velocities of the spheres, shape (sphere_count, 3)."""
    for _ in range(frames):
        simulator.step()
    state = simulator.state
    return state.sphere_positions.numpy()[0].astype(float), state.sphere_velocities.numpy()[0].astype(float)


def pair(
    speed: float = 1.0, aside: float = 0.0, masses: tuple = (1.0, 1.0), restitution: tuple = (1.0, 1.0)
) -> list[Sphere]:
    """Return a sphere of 10 cm that flies at one of 20 cm at rest; their surfaces are half a meter apart."""
    return [
        Sphere(
            position=(-0.8, aside, 0), radius=0.1, mass=masses[0], velocity=(speed, 0, 0), restitution=restitution[0]
        ),
        Sphere(position=(0, 0, 0), radius=0.2, mass=masses[1], restitution=restitution[1]),
    ]


@pytest.mark.full
def test_equal_spheres_exchange_their_velocities(layout, device):
    """Equal spheres exchange their velocities in a head-on elastic collision, from where they met."""
    simulator = billiard(device, pair(), **layout)
    centers, velocities = after(simulator, 100)
    np.testing.assert_allclose(velocities, [(0, 0, 0), (1, 0, 0)], atol=EPSILON)
    # a thousand steps round each place by half an epsilon of a meter, all to one side at worst
    np.testing.assert_allclose(centers, [(-0.3, 0, 0), (0.5, 0, 0)], atol=500 * EPSILON)


@pytest.mark.parametrize(("restitution", "mean"), [((0.0, 0.0), 0.0), ((0.5, 0.5), 0.5), ((1.0, 0.25), 0.5)])
def test_they_leave_at_the_speed_of_impact_times_the_restitution(restitution, mean, device):
    """Velocities are the textbook's v1' = (m1 - e m2) v / M, v2' = (1 + e) m1 v / M, with the mean restitution."""
    simulator = billiard(device, pair(masses=(3.0, 1.0), restitution=restitution))
    _, velocities = after(simulator, 100)
    np.testing.assert_allclose(velocities[:, 0], [(3.0 - mean) / 4.0, 3.0 * (1.0 + mean) / 4.0], rtol=4.0 * EPSILON)


def test_an_oblique_impact_is_along_the_line_through_the_centers(layout, device):
    """The normal at an offset b is at the angle asin(b / R) to the path: of equal elastic spheres the struck one leaves
    along it with v cos, the other across it with v sin. The step at which they meet does not matter."""
    angle = 0.6
    simulator = billiard(device, pair(speed=3.0, aside=-0.3 * np.sin(angle)), **layout)
    _, velocities = after(simulator, 60)
    along, across = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([np.sin(angle), -np.cos(angle), 0.0])
    # the centers' rounding over the sum of the radii turns the normal: 200 steps, of half an epsilon each
    atol = 3.0 * 100 * EPSILON / 0.3
    np.testing.assert_allclose(velocities[1], 3.0 * np.cos(angle) * along, atol=atol)
    np.testing.assert_allclose(velocities[0], 3.0 * np.sin(angle) * across, atol=atol)


@pytest.mark.parametrize("speed", [10.0, 1000.0, 100_000.0])
def test_none_goes_through_another_at_any_speed(speed, layout, device):
    """Spheres do not tunnel at any speed: at the highest, a step goes 100 m, 333 times the sum of the radii."""
    simulator = billiard(device, pair(speed, aside=0.05, restitution=(0.3, 0.3)), **layout)
    centers, velocities = after(simulator, 10)
    assert velocities[1, 0] > 0.4 * speed
    np.testing.assert_allclose(velocities.sum(axis=0), (speed, 0, 0), atol=2.0 * EPSILON * speed)
    assert centers[1, 0] - centers[0, 0] > 0.0


def cloud(seed: int, count: int = 12, restitution: float = 1.0) -> list[Sphere]:
    """Return spheres of different sizes and masses that fly at each other."""
    numbers = np.random.default_rng(seed)
    places = np.stack(np.meshgrid(*[np.arange(3) - 1.0] * 3), axis=-1).reshape(-1, 3)[:count]
    return [
        Sphere(
            position=tuple(place + numbers.uniform(-0.1, 0.1, 3)),
            velocity=tuple(-4.0 * place + numbers.uniform(-1, 1, 3)),
            radius=numbers.uniform(0.05, 0.3),
            mass=numbers.uniform(0.1, 3.0),
            restitution=restitution,
        )
        for place in places
    ]


@pytest.mark.full
@pytest.mark.parametrize("restitution", [1.0, 0.5, 0.0])
def test_a_cloud_of_them_keeps_momentum_and_angular_momentum_and_gains_no_energy(restitution, device):
    simulator = billiard(device, cloud(3, restitution=restitution))
    start, energy = sphere_momenta(simulator), sphere_energies(simulator).sum()
    centers = simulator.state.sphere_positions.numpy()[0].astype(float)
    spin, size, met = np.cross(centers, start).sum(axis=0), np.abs(start).sum(), 0.0
    for frame in range(1, 101):
        places, _ = after(simulator, 1)
        momenta, steps = sphere_momenta(simulator), 10 * frame
        # each of some tens of impacts rounds by an epsilon; places, of up to 5 m, each step by half of that
        np.testing.assert_allclose(momenta.sum(axis=0), start.sum(axis=0), atol=30 * EPSILON * size)
        rounding = EPSILON * size * (30 * 5.0 + 5.0 * np.sqrt(steps))
        np.testing.assert_allclose(np.cross(places, momenta).sum(axis=0), spin, atol=rounding)
        now = sphere_energies(simulator).sum()
        assert now < energy * (1.0 + 30 * EPSILON)
        met, energy = max(met, float(np.abs(momenta - start).max())), min(energy, now)
    assert met > 1.0
    if restitution == 1.0:
        np.testing.assert_allclose(energy, sphere_energies(billiard(device, cloud(3))).sum(), rtol=60 * EPSILON)


@pytest.mark.full
def test_none_is_in_another_after_a_crowd_has_met(device):
    """No spheres overlap after a crowd has met: an unresolved overlap falls by a tenth in a hundredth of a second."""
    spheres = cloud(7, count=27, restitution=0.3)
    centers, _ = after(billiard(device, spheres, ground=Ground(height=-1.6), gravity=9.8), 150)
    radii = np.array([sphere.radius for sphere in spheres])
    gaps = np.linalg.norm(centers[:, None] - centers, axis=-1) - radii - radii[:, None]
    gaps[np.diag_indices(len(radii))] = np.inf
    assert gaps.min() > -0.01 * radii.max()
    assert (centers[:, 1] > -1.6 + radii - 0.01 * radii.max()).all()


@pytest.mark.parametrize("contact", ["penalty", "impulse"])
def test_stacks_stand_still(contact, layout, device):
    """Stacks of two on the ground and on an obstacle stay at rest: a step of gravity moves each by g h^2, 10
    micrometers, and that overlap is resolved."""
    places = [(x, below + y, 0.0) for x, below in ((0.0, 0.0), (9.0, 0.5)) for y in (0.2, 0.6)]
    stacks = [Sphere(position=at, radius=0.2, mass=m) for at, m in zip(places, (1.0, 2.0, 1.0, 2.0), strict=True)]
    floor = {"ground": Ground(), "obstacle": [Obstacle(size=(4, 1, 4), position=(9, 0, 0))]}
    simulator = billiard(device, stacks, gravity=9.8, contact=contact, **floor, **layout)
    centers, velocities = after(simulator, 100)
    step = simulator.model.step_seconds
    np.testing.assert_allclose(centers, np.float32(places), atol=20 * 9.8 * step**2)
    assert np.abs(velocities).max() < 4 * 9.8 * step


def test_one_that_is_not_there_yet_meets_none(device):
    """A sphere collides with none before it appears; one that appears inside another is pushed out without speed."""
    late = [Sphere(position=(0, 0, 0), radius=0.2, start=0.5), Sphere(position=(0.3, 0, 0), radius=0.2)]
    simulator = billiard(device, late)
    centers, _ = after(simulator, 50)
    np.testing.assert_array_equal(centers, np.float32([(0, 0, 0), (0.3, 0, 0)]))
    centers, velocities = after(simulator, 10)
    assert 0.33 < centers[1, 0] - centers[0, 0] < 0.4
    assert np.abs(velocities).max() == 0.0


def test_worlds_do_not_hear_of_each_other(device):
    """A world of a batch is bit-identical to the scene run alone, whatever the others do."""
    speeds = [1.0, 40.0, 0.0]
    scene = billiard(device, pair(restitution=(0.8, 0.8))).model.scene
    batch = Simulator(scene, device, world_count=3, vary={"sphere.0.velocity.0": speeds})
    after(batch, 80)
    for world, speed in enumerate(speeds):
        first = scene.sphere[0].model_copy(update={"velocity": (speed, 0.0, 0.0)})
        alone = Simulator(scene.model_copy(update={"sphere": [first, scene.sphere[1]]}), device)
        after(alone, 80)
        np.testing.assert_array_equal(
            batch.state.sphere_positions.numpy()[world], alone.state.sphere_positions.numpy()[0]
        )

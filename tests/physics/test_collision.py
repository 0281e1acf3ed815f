"""Spheres that meet spheres, the ground and obstacles: impacts, restitution, friction and spin."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from conserved import advanced, sphere_energies, sphere_momenta, sphere_spins, sphere_turning
from law_functions import COUNT, called
from meshes import cube, mesh_of
from numpy.typing import NDArray

from balloon_warp import Balloon, Ground, Inflation, Obstacle, Scene, Simulator, Sphere, Stiffness
from balloon_warp.kernels.laws.collision import collision

EPSILON = float(np.finfo(np.float32).eps)
NO_SPRINGS = Stiffness(structural=0.0, shear=0.0, flexion=0.0)
G = 9.81


@pytest.fixture(params=["symplectic_euler", "projective"])
def solver(request: pytest.FixtureRequest) -> str:
    """Return each solver: spheres move alike in both."""
    return request.param


def billiard(device: str, spheres: list[Sphere], **fields: Any) -> Simulator:
    """Return spheres in space, with a balloon far away; 10 steps a frame of a hundredth of a second."""
    away = Balloon(mesh=cube(), position=(0, 0, 900.0), stiffness=NO_SPRINGS, inflation=Inflation(k_normal=0.0))
    setting = {"gravity": 0.0, "frames_per_second": 100.0, "substeps": 10}
    return Simulator(Scene(balloon=[away], sphere=spheres, **setting | fields), device)


def after(simulator: Simulator, frames: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return centers and velocities of the spheres, shape (sphere_count, 3)."""
    advanced(simulator, frames)
    state = simulator.state
    return state.sphere_positions.numpy()[0].astype(float), state.sphere_velocities.numpy()[0].astype(float)


def pair(
    speed: float = 1.0, aside: float = 0.0, masses: tuple = (1.0, 1.0), restitution: tuple = (1.0, 1.0)
) -> list[Sphere]:
    """Return a sphere of 10 cm that flies at one of 20 cm at rest; their surfaces are half a meter apart."""
    flying = {"position": (-0.8, aside, 0), "velocity": (speed, 0, 0), "radius": 0.1}
    return [
        Sphere(mass=masses[0], restitution=restitution[0], **flying),
        Sphere(position=(0, 0, 0), radius=0.2, mass=masses[1], restitution=restitution[1]),
    ]


@wp.func
def gain_of(approach: float, restitution: float, gravity: float, step_seconds: float):
    """Return the gain of a sphere that comes straight down on another, along the way up [m/s]."""
    start, way = wp.vec3(0.0, 0.3 + 0.5 * approach * step_seconds, 0.0), wp.vec3(0.0, -approach * step_seconds, 0.0)
    up = wp.vec3(0.0, 1.0, 0.0)
    _shift, gain, _part = collision(start, way, way / step_seconds, 0.3, restitution, gravity, up, step_seconds)
    return gain[1]


@pytest.mark.always
def test_nothing_rebounds_at_the_speed_of_two_steps_of_gravity():
    """Speeds above 2 g dt gain 1 + e times themselves, and slower ones just themselves."""
    random = np.random.default_rng(0)
    step, speeds = 1e-3, random.uniform(0.5, 4.0, COUNT)
    samples = {"approach": speeds * step * G, "restitution": random.uniform(0.2, 1.0, COUNT)}
    samples |= {"gravity": np.full(COUNT, -G), "step_seconds": np.full(COUNT, step)}
    samples = {name: each.astype(np.float32) for name, each in samples.items()}
    expected = np.where(speeds > 2.0, 1.0 + samples["restitution"], 1.0) * samples["approach"]
    np.testing.assert_allclose(called(gain_of, samples), expected, rtol=1e-5)


@pytest.mark.parametrize(
    ("masses", "restitution", "mean"),
    [
        ((1.0, 1.0), (1.0, 1.0), 1.0),
        ((3.0, 1.0), (0.0, 0.0), 0.0),
        ((3.0, 1.0), (0.5, 0.5), 0.5),
        ((3.0, 1.0), (1.0, 0.25), 0.5),
    ],
)
def test_they_leave_at_the_speed_of_impact_times_the_restitution(
    masses: tuple, restitution: tuple, mean: float, device: str
):
    """Velocities are the textbook's v1' = (m1 - e m2) v / M, v2' = (1 + e) m1 v / M, with the mean restitution; from
    where they met, half a second after the start. A thousand steps round each place by half an epsilon of a meter, all
    to one side at worst."""
    centers, velocities = after(billiard(device, pair(masses=masses, restitution=restitution)), 100)
    whole = sum(masses)
    expected = np.array([masses[0] - mean * masses[1], (1.0 + mean) * masses[0]]) / whole
    np.testing.assert_allclose(velocities[:, 0], expected, rtol=0, atol=EPSILON)
    np.testing.assert_allclose(centers[:, 0], np.array([-0.3, 0.0]) + 0.5 * expected, atol=500 * EPSILON)


def test_an_oblique_impact_is_along_the_line_through_the_centers(solver: str, device: str):
    """The normal at an offset b is at the angle asin(b / R) to the path: of equal elastic spheres the struck one leaves
    along it with v cos, the other across it with v sin. The step at which they meet does not matter."""
    angle = 0.6
    _, velocities = after(billiard(device, pair(speed=3.0, aside=-0.3 * np.sin(angle)), solver=solver), 60)
    along, across = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([np.sin(angle), -np.cos(angle), 0.0])
    # the centers' rounding over the sum of the radii turns the normal: 200 steps, of half an epsilon each
    atol = 3.0 * 100 * EPSILON / 0.3
    np.testing.assert_allclose(velocities[1], 3.0 * np.cos(angle) * along, atol=atol)
    np.testing.assert_allclose(velocities[0], 3.0 * np.sin(angle) * across, atol=atol)


@pytest.mark.parametrize("speed", [10.0, 1000.0, 100_000.0])
def test_none_goes_through_another_at_any_speed(speed: float, solver: str, device: str):
    simulator = billiard(device, pair(speed, aside=0.05, restitution=(0.3, 0.3)), solver=solver)
    centers, velocities = after(simulator, 10)
    assert velocities[1, 0] > 0.4 * speed
    np.testing.assert_allclose(velocities.sum(axis=0), (speed, 0, 0), atol=2.0 * EPSILON * speed)
    assert centers[1, 0] - centers[0, 0] > 0.0


def cloud(seed: int, **fields: float) -> list[Sphere]:
    """Return spheres of different sizes and masses that fly at each other."""
    numbers = np.random.default_rng(seed)
    places = np.stack(np.meshgrid(*[np.arange(3) - 1.0] * 3), axis=-1).reshape(-1, 3)[:12]
    spheres = []
    for place in places:
        at, going = place + numbers.uniform(-0.1, 0.1, 3), -4.0 * place + numbers.uniform(-1, 1, 3)
        size = {"radius": numbers.uniform(0.05, 0.3), "mass": numbers.uniform(0.1, 3.0)}
        spheres.append(Sphere(position=tuple(at), velocity=tuple(going), **size, **fields))
    return spheres


@pytest.mark.parametrize(("restitution", "friction"), [(1.0, 0.0), (0.5, 0.0), (0.0, 0.0), (1.0, 0.5)])
def test_a_cloud_keeps_momentum_and_angular_momentum_and_gains_no_energy(restitution: float, friction: float, device):
    """Each of some tens of impacts rounds by an epsilon; places, of up to 5 m, each step by half of that. Spins add
    their own."""
    simulator = billiard(device, cloud(3, restitution=restitution, friction=friction))
    start, spin = sphere_momenta(simulator), sphere_turning(simulator)
    first = energy = sphere_energies(simulator).sum()
    size, met = np.abs(start).sum(), 0.0
    for frame in range(1, 101):
        after(simulator, 1)
        momenta = sphere_momenta(simulator)
        np.testing.assert_allclose(momenta.sum(axis=0), start.sum(axis=0), atol=30 * EPSILON * size)
        rounding = 400.0 if friction else 30 * 5.0 + 5.0 * np.sqrt(10 * frame)
        np.testing.assert_allclose(sphere_turning(simulator), spin, atol=rounding * EPSILON * size)
        now = sphere_energies(simulator).sum()
        assert now < energy * (1.0 + 30 * EPSILON)
        met, energy = max(met, float(np.abs(momenta - start).max())), min(energy, now)
    assert met > 1.0
    assert (np.abs(sphere_spins(simulator)).max() > 1.0) == bool(friction)
    if restitution == 1.0 and not friction:
        np.testing.assert_allclose(energy, first, rtol=60 * EPSILON)


@pytest.mark.parametrize("contact", ["penalty", "impulse"])
def test_stacks_stand_still(contact: str, solver: str, device: str):
    """Stacks of two on the ground and on an obstacle stay at rest: a step of gravity moves each by g h^2, 10
    micrometers, and that overlap is resolved."""
    places = [(x, below + y, 0.0) for x, below in ((0.0, 0.0), (9.0, 0.5)) for y in (0.2, 0.6)]
    stacks = [Sphere(position=at, radius=0.2, mass=m) for at, m in zip(places, (1.0, 2.0, 1.0, 2.0), strict=True)]
    floor = {"ground": Ground(), "obstacle": [Obstacle(size=(4, 1, 4), position=(9, 0, 0))]}
    simulator = billiard(device, stacks, gravity=9.8, contact=contact, solver=solver, **floor)
    centers, velocities = after(simulator, 100)
    step = simulator.model.step_seconds
    np.testing.assert_allclose(centers, np.float32(places), atol=20 * 9.8 * step**2)
    assert np.abs(velocities).max() < 4 * 9.8 * step


def test_one_that_is_not_there_yet_meets_none(device: str):
    """A sphere collides with none before it appears; one that appears inside another is pushed out without speed."""
    late = [Sphere(position=(0, 0, 0), radius=0.2, start=0.5), Sphere(position=(0.3, 0, 0), radius=0.2)]
    simulator = billiard(device, late)
    centers, _ = after(simulator, 50)
    np.testing.assert_array_equal(centers, np.float32([(0, 0, 0), (0.3, 0, 0)]))
    centers, velocities = after(simulator, 10)
    assert 0.33 < centers[1, 0] - centers[0, 0] < 0.4
    assert np.abs(velocities).max() == 0.0


@pytest.mark.parametrize("contact", ["penalty", "impulse"])
@pytest.mark.parametrize("restitution", [0.8, 1.0])
@pytest.mark.parametrize(("substeps", "tolerance"), [(2, 0.1), (200, 0.01)])
@pytest.mark.parametrize("floor", ["ground", "obstacle"])
def test_a_sphere_bounces_by_its_restitution_and_gains_nothing(
    floor: str, substeps: int, tolerance: float, restitution: float, contact: str, device: str
):
    """A sphere rebounds from H to e^2 H, less a step's error of order g h T; never above, however long the step."""
    dropped = [Sphere(position=(0.0, 1.5, 0.0), radius=0.5)]
    table = Obstacle(size=(2.0, 0.2, 2.0), position=(0, -0.1, 0), restitution=restitution)
    below = {"obstacle": [table]} if floor == "obstacle" else {"ground": Ground(restitution=restitution)}
    setting: dict[str, Any] = {"gravity": G, "frames_per_second": 60.0, "substeps": substeps, "contact": contact}
    simulator = billiard(device, dropped, **setting, **below)
    heights = [after(simulator, 1)[0][0, 1] - 0.5 for _ in range(60)]
    assert min(heights) >= -1e-6
    rebound = max(heights[int(np.argmin(heights)) :])
    np.testing.assert_allclose(rebound, restitution**2, rtol=tolerance)
    assert rebound < 1.0 + 1e-5


@pytest.mark.parametrize("contact", ["penalty", "impulse"])
@pytest.mark.parametrize("substeps", ["auto", 1, 13])
def test_a_sphere_on_the_ground_keeps_its_height_for_ten_seconds(substeps: str | int, contact: str, device: str):
    """A sphere of restitution 1 rises to within 0.5 % of its height: a step conserves v^2 / 2 + g y - g h v / 2."""
    dropped = [Sphere(position=(0.0, 1.1, 0.0), radius=0.1)]
    setting: dict[str, Any] = {"gravity": G, "frames_per_second": 60.0, "substeps": substeps, "contact": contact}
    simulator = billiard(device, dropped, ground=Ground(restitution=1.0), **setting)
    centers, velocities = after(simulator, 600)
    rise = velocities[0, 1]
    top = centers[0, 1] - 0.1 + rise**2 / (2.0 * G) - 0.5 * simulator.model.step_seconds * rise
    np.testing.assert_allclose(top, 1.0, atol=0.005)


ANGLE = 0.5


@pytest.mark.parametrize("contact", ["penalty", "impulse"])
def test_it_slides_slower_until_it_rolls(contact: str, solver: str, device: str):
    """A sphere slides until it rolls. On the ground with 0.2, the root of 0.1 and 0.4, it slows down by 0.2 g, while
    the spin grows by 5/2 of that over the radius; at 5/7 of its speed it rolls. One without friction slides on. With
    spin backwards, 4 v / R, one comes back at (5 - 8) / 7 v. Down a slope it rolls with 5/7 g sin where friction is at
    least 2/7 tan, else it slides with g (sin - friction cos), on a box as on its mesh."""
    normal = np.array([np.sin(ANGLE), np.cos(ANGLE), 0.0])
    slab = mesh_of((cube().points - 0.5) * [4.0, 1.0, 8.0], cube().face_vertex_indices.reshape(-1, 4).tolist())
    rough = {"friction": 1.0, "restitution": 0.0, "rotation": (0, 0, -np.degrees(ANGLE))}
    slopes = [Obstacle(position=(0, 50, 0), size=(4, 1, 8), **rough), Obstacle(position=(0, 90, 0), mesh=slab, **rough)]
    balls = [
        Sphere(position=(0, 0.1, z), radius=0.1, velocity=(1.0, 0.0, 0.0), friction=friction, angular_velocity=spin)
        for z, friction, spin in ((0, 0.1, (0, 0, 0)), (1, 0.0, (0, 0, 0)), (2, 0.1, (0, 0, 40.0)))
    ]
    places = [(y, z, friction) for y in (50, 90) for z, friction in ((-1, 0.25), (1, 0.01))]
    balls += [Sphere(position=tuple((0, y, z) + 0.6001 * normal), radius=0.1, friction=mu) for y, z, mu in places]
    ground = Ground(friction=0.4, restitution=0.0)
    simulator = billiard(device, balls, gravity=G, ground=ground, obstacle=slopes, contact=contact, solver=solver)
    _, velocities = after(simulator, 10)
    expected = 1.0 - 0.2 * G * 0.1
    np.testing.assert_allclose(velocities[:3, 0], (expected, 1.0, expected), rtol=100 * EPSILON)
    turned_by = (-0.5 * G, 0.0, 40.0 - 0.5 * G)
    np.testing.assert_allclose(sphere_spins(simulator)[:3, 2], turned_by, rtol=200 * EPSILON)
    _, later = after(simulator, 20)
    gained = (later - velocities)[3:] @ (np.cos(ANGLE), -np.sin(ANGLE), 0.0) / 0.2
    rolls, slides = 5 / 7 * np.sin(ANGLE) * G, (np.sin(ANGLE) - 0.1 * np.cos(ANGLE)) * G
    np.testing.assert_allclose(gained, (rolls, slides) * 2, rtol=1e-3)  # rounding decides how often each is pushed
    _, velocities = after(simulator, 100)
    np.testing.assert_allclose(velocities[:3, 0], (5 / 7, 1.0, -3 / 7), rtol=2e-4)  # and the rounding of 1,300 steps
    np.testing.assert_allclose(sphere_spins(simulator)[:3, 2], (-50 / 7, 0.0, 30 / 7), rtol=2e-4)

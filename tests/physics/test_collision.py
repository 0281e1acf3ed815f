"""Spheres that meet spheres, the ground, obstacles and balloons: impacts, restitution, friction and spin; momentum
exchange by `contact = "impulse"`, the paper's penalty, and a warning before a sphere tunnels."""

import re
from typing import Any

import numpy as np
import pytest
import warp as wp
from conserved import advanced, after_each, motion, put, sphere_momenta, sphere_spins, whole
from law_functions import COUNT, called, compile_together
from meshes import cube, mesh_of, quad_sphere
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from balloon_warp import Atmosphere, Balloon, Ground, Inflation, Obstacle, Scene, Simulator, Sphere, Stiffness
from balloon_warp.blow_ups import Pulls
from balloon_warp.kernels.laws.contact import collision
from balloon_warp.model import plan_model
from balloon_warp.model.stability import widest_opening
from balloon_warp.scene.load import bundled_scenes, load_scene

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


compile_together({gain_of: "float32"})


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
    """v1' = (m1 - e m2) v / M, v2' = (1 + e) m1 v / M with the mean restitution, from where they met, after half a
    second. A thousand steps round each place by half an epsilon of a meter, all to one side at worst."""
    centers, velocities = after(billiard(device, pair(masses=masses, restitution=restitution)), 100)
    whole = sum(masses)
    expected = np.array([masses[0] - mean * masses[1], (1.0 + mean) * masses[0]]) / whole
    np.testing.assert_allclose(velocities[:, 0], expected, rtol=0, atol=EPSILON)
    np.testing.assert_allclose(centers[:, 0], np.array([-0.3, 0.0]) + 0.5 * expected, atol=500 * EPSILON)


def test_an_oblique_impact_is_along_the_line_through_the_centers(solver: str, device: str):
    """The normal is at asin(offset / R) to the path: the struck one leaves along it with v cos, the other across with v
    sin."""
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


@pytest.mark.parametrize("contact", ["penalty", "impulse"])
def test_stacks_stand_still(contact: str, solver: str, device: str):
    """A step of gravity moves each sphere by g h^2, 10 micrometers, and that overlap is resolved."""
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


@pytest.mark.parametrize("rotation", [(10.0, 0.0, 20.0), (-35.0, 40.0, 15.0)])
def test_a_sphere_leaves_a_tilted_box_from_where_it_met_it(rotation: tuple[float, float, float], device: str):
    """A sphere without friction and gravity follows the mirrored path, to within the length of a step."""
    normal = Rotation.from_euler("xyz", rotation, degrees=True).apply((0.0, 1.0, 0.0))
    way, start, radius, seconds = np.array([0.5, -3.0, 0.2]), np.array([0.1, 0.9, 0.0]), 0.2, 0.5
    floor = Obstacle(size=(8.0, 0.2, 8.0), rotation=rotation, friction=0.0, restitution=1.0)
    ball = Sphere(position=tuple(start), velocity=tuple(way), radius=radius, mass=1.0, restitution=1.0, friction=0.0)
    centers, velocities = after(billiard(device, [ball], obstacle=[floor], contact="impulse"), round(seconds * 100))
    met = (0.1 + radius - start @ normal) / (way @ normal)
    mirrored = way - 2.0 * (way @ normal) * normal
    np.testing.assert_allclose(velocities[0], mirrored, atol=1e-5)
    np.testing.assert_allclose(centers[0], start + met * way + (seconds - met) * mirrored, atol=3.1e-3)


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


HARD = {"friction": 0.0, "restitution": 1.0}
FLOORS: dict[str, dict[str, Any]] = {
    "ground": {"ground": Ground(restitution=1.0)},
    "box": {"obstacle": [Obstacle(size=(2.0, 0.2, 2.0), position=(0, -0.1, 0), **HARD)]},
    "capsule": {
        "obstacle": [
            Obstacle(shape="capsule", radius=0.3, length=2.0, rotation=(0, 0, 90), position=(0, -0.3, 0), **HARD)
        ]
    },
    "slopes": {
        "obstacle": [
            Obstacle(size=(8, 0.2, 8), rotation=(0, 0, degrees), position=(aside, -0.1, 0), **HARD)
            for degrees, aside in ((-40.0, -0.1), (30.0, 0.1))
        ]
    },
}


@pytest.mark.parametrize("contact", ["penalty", "impulse"])
@pytest.mark.parametrize("substeps", ["auto", 1, 13])
@pytest.mark.parametrize("floor", FLOORS)
def test_a_sphere_keeps_its_height_for_ten_seconds(floor: str, substeps: str | int, contact: str, device: str):
    """A sphere of restitution 1 rises to within 0.5 % of its height: a step conserves v^2 / 2 + g y - g h v / 2."""
    dropped = [Sphere(position=(0.0, 1.1, 0.0), radius=0.1)]
    setting: dict[str, Any] = {"gravity": G, "frames_per_second": 60.0, "substeps": substeps, "contact": contact}
    simulator = billiard(device, dropped, **FLOORS[floor], **setting)
    centers, velocities = after(simulator, 600)
    kinetic, rise = (velocities[0] ** 2).sum() / (2.0 * G), velocities[0, 1]
    top = centers[0, 1] - 0.1 + kinetic - 0.5 * simulator.model.step_seconds * rise
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


NO_INFLATION = Inflation(k_normal=0.0)
CORNER = cube().points[6]


def struck(device: str, mass: float, balloon: dict | None = None, **fields: Any) -> Simulator:
    """Return a balloon at rest that a sphere of this mass hits off its center at 2 m/s, in space."""
    ball = {"mesh": quad_sphere(4, radius=0.5), "mass": 0.5, "damping": 0.0, "inflation": NO_INFLATION}
    sphere = Sphere(position=(0.1, 0.9, 0.05), radius=0.3, mass=mass, velocity=(0.0, -2.0, 0.3))
    setting = {"gravity": 0.0, "contact": "impulse", "substeps": 40, "atmosphere": Atmosphere(density=0.0)}
    return Simulator(
        Scene(**{"balloon": [Balloon(**ball | (balloon or {}))], "sphere": [sphere]} | setting | fields), device
    )


def depth(simulator: Simulator) -> float:
    """Return the largest depth of a particle in a sphere [m], if it is above 0."""
    points, _ = motion(simulator)
    centers = simulator.state.sphere_positions.numpy()[0]
    radii = simulator.model.parameters["sphere_radius"].numpy()[0]
    return float((radii - np.linalg.norm(points[:, None] - centers, axis=2)).max())


def energies(simulator: Simulator, frames: int) -> list[float]:
    """Return the energy of balloons and spheres [J], before and after each of so many frames."""
    return [whole(simulator)[2], *after_each(simulator, frames, lambda each: whole(each)[2])]


@pytest.mark.parametrize("ratio", [0.001, 0.04, 1.0, 40.0, 1000.0])
@pytest.mark.parametrize("substeps", ["auto", 60, 240])
def test_a_collision_keeps_momentum_and_gives_no_energy_at_any_step_and_mass(
    ratio: float, substeps: int | str, device: str
):
    """Symplectic Euler's energy swings by some thousandths; a substep rounds velocities by up to half an epsilon. The
    ratio is of the sphere's mass to the balloon's."""
    simulator = struck(device, ratio * 0.5, substeps=substeps)
    before = whole(simulator)
    found = energies(simulator, 30)
    rounding = EPSILON * np.sqrt(simulator.model.substeps * 30) * (ratio + 1.0)
    for now, start in zip(whole(simulator)[:2], before[:2], strict=True):
        np.testing.assert_allclose(now, start, atol=rounding)
    assert max(found) < 1.005 * found[0]
    assert found[-1] < (1.0 - 1e-5) * found[0]
    assert np.linalg.norm(simulator.state.sphere_velocities.numpy()[0, 0]) < np.linalg.norm((0.0, -2.0, 0.3))
    assert depth(simulator) < 1e-5


def bare_cubes(device: str, spheres: list[Sphere], cubes: int = 1, **fields: Any) -> Simulator:
    """Return unit cubes without springs, inflation or damping, all at one place; a step a frame, of a millisecond."""
    still = {"mesh": cube(), "mass": 0.8, "stiffness": NO_SPRINGS, "inflation": NO_INFLATION, "damping": 0.0}
    setting = {"gravity": 0.0, "contact": "impulse", "substeps": 1, "frames_per_second": 1000.0, "faces": False}
    setting["touch"] = False  # they are in each other
    still |= fields.pop("balloon", {})
    return Simulator(Scene(balloon=[Balloon(**still)] * cubes, sphere=spheres, **setting | fields), device)


@pytest.mark.parametrize("sphere_mass", [0.024, 1.2, 240.0])
def test_balloons_that_touch_all_over_stick_to_the_sphere(sphere_mass: float, device: str):
    """Both go on at the mean of their speeds by mass. The corners see it under up to 0.7 / 29 from the middle."""
    wall = Sphere(position=(-28.9, 0.5, 0.5), radius=30.0, mass=sphere_mass)
    simulator = bare_cubes(device, [wall], cubes=3)
    put(simulator, velocities=np.tile([-2.0, 0.0, 0.0], (24, 1)))
    simulator.step()
    together = -2.0 * 2.4 / (2.4 + sphere_mass)
    velocities = motion(simulator)[1]
    np.testing.assert_allclose(velocities[:, 0], together, atol=2.0 * 0.025**2)
    np.testing.assert_allclose(velocities[:, 1:], 0.0, atol=2.0 * 0.025)
    np.testing.assert_allclose(sphere_momenta(simulator)[0] / sphere_mass, [together, 0.0, 0.0], atol=2.0 * 0.025**2)


def test_what_a_body_and_its_particles_do_is_the_nearest_that_is_allowed(device: str):
    """Conditions of Karush, Kuhn and Tucker: no penetration, impulses push and never pull, and a pushed particle
    arrives at the surface. Eight corners come at a light sphere in their midst at random, in one step."""
    sphere = Sphere(position=(0.5, 0.5, 0.5), radius=0.86, mass=0.05, velocity=(1.0, 0.0, 0.0))
    simulator = bare_cubes(device, [sphere], frames_per_second=500.0)
    points = motion(simulator)[0]
    random = np.random.default_rng(3)
    velocities = random.normal(scale=3.0, size=(8, 3)) + 3.0 * (0.5 - points)
    put(simulator, velocities=velocities)
    simulator.step()
    outward = (points - 0.5) / np.linalg.norm(points - 0.5, axis=1)[:, None]
    gaps = np.linalg.norm(points - 0.5, axis=1) - 0.86
    after = motion(simulator)[1]
    of_sphere = simulator.state.sphere_velocities.numpy()[0, 0].astype(np.float64)
    gains = after - velocities
    pushes = (gains * outward).sum(axis=1)
    slack = ((after - of_sphere) * outward).sum(axis=1) + gaps * 500.0
    rounding = 1e-3  # of gaps of millimeters, in float32, over a step of two milliseconds
    np.testing.assert_allclose(gains, pushes[:, None] * outward, atol=rounding)
    assert pushes.min() > -rounding
    assert slack.min() > -rounding
    assert np.abs(np.minimum(pushes, slack)).max() < rounding
    assert (pushes > 10.0 * rounding).sum() >= 3
    assert (slack > 10.0 * rounding).any()


def test_a_balloon_carries_a_sphere(device: str):
    """The paper's penalty gives way to a sphere so heavy for the inflation."""
    stiff = Stiffness(structural=200.0, shear=100.0, flexion=100.0, viscosity=0.01)
    balloon = Balloon(
        mesh=quad_sphere(4, 0.5), position=(0.0, 0.5, 0.0), mass=0.5, damping=3.0, stiffness=stiff,
        inflation=Inflation(k_normal=0.2),
    )  # fmt: skip
    sphere = Sphere(position=(0.0, 1.15, 0.0), radius=0.3, mass=0.4)
    heights, pushes = {}, {}
    for contact in ("impulse", "penalty"):
        scene = Scene(balloon=[balloon], sphere=[sphere], ground=Ground(), contact=contact, normals="cached")
        simulator = Simulator(scene, device)
        advanced(simulator, 180)
        heights[contact] = float(simulator.state.sphere_positions.numpy()[0, 0, 1])
        pushes[contact] = simulator.state.sphere_forces.numpy()[0, 0]
    assert heights["impulse"] > 1.05
    np.testing.assert_allclose(pushes["impulse"], [0.0, 0.4 * 9.81, 0.0], atol=4e-3)
    assert heights["penalty"] < 0.5


def test_a_diagnosis_names_all_touching_particles(device: str):
    simulator = struck(device, 0.5)
    assert Pulls(simulator.model, simulator.state, 0).contact_at(0, newtons=0.0) is None
    advanced(simulator, 5)
    push = Pulls(simulator.model, simulator.state, 0).contact_at(0, newtons=3.0)
    assert re.fullmatch(r"\d+ particles in contact with it pushed it with 3 N", str(push))


@pytest.mark.parametrize(
    ("k_normal", "substeps", "sums"), [(0.6, 2, 0.6), ([(0.0, 0.2), (0.001, 1.0)], 4, 0.2 + 0.4 + 0.6)]
)
def test_penalty_force_is_the_touching_particles_inflation(k_normal: Any, substeps: int, sums: float, device: str):
    """The speed changes by h penalty 100 k_normal (A_p / A) / M; of four substeps, k_normal at the begin of the first
    three acts in the next."""
    sphere = Sphere(position=tuple(CORNER + [0.0, 0.15, 0.0]), radius=0.2, mass=3.0, penalty=2.0)
    inflation = {"inflation": Inflation(k_normal=k_normal)}
    simulator = bare_cubes(device, [sphere], contact="penalty", substeps=substeps, normals="cached", balloon=inflation)
    velocity = simulator.step().sphere_velocities[0]
    expected = (0.001 / substeps) * 2.0 * (100.0 * sums / 6.0) / 3.0
    np.testing.assert_allclose(velocity[1], expected, rtol=0.01)  # the corner has moved by some micrometers


@pytest.mark.parametrize("radius", [0.65, 0.75])
def test_a_sphere_that_fits_between_the_corners_of_a_face_passes_untouched(radius: float, device: str):
    assert widest_opening(cube()) == pytest.approx(np.sqrt(0.5))
    still = Balloon(mesh=cube(), inflation=Inflation(k_normal=0.0), damping=0.0)
    sphere = Sphere(position=(0.5, 2.0, 0.5), radius=radius, mass=1.0, velocity=(0.0, -20.0, 0.0))
    scene = Scene(balloon=[still], sphere=[sphere], gravity=0.0, contact="impulse", substeps=40, faces=False)
    simulator = Simulator(scene, device)
    advanced(simulator, 4)
    moved = np.abs(motion(simulator)[1]).max() > 0.01
    assert moved == (radius > widest_opening(cube()))


FALLING = {
    "balloon": [Balloon(mesh=quad_sphere(8, radius=0.5), position=(0.0, 0.5, 0.0), mass=9.0)],
    "sphere": [Sphere(position=(0.0, 80.0, 0.0), radius=0.3)],
    "ground": Ground(), "gravity": 10.0, "substeps": 2, "normals": "fresh",
}  # fmt: skip


def above(radius: float) -> list[Sphere]:
    """Return a large sphere beside cubes, and one above them."""
    return [Sphere(position=(9.0, 9.0, 9.0), radius=2.0), Sphere(position=(0.0, 5.0, 0.0), radius=radius)]


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"sphere": above(0.65)}, r"^sphere 1: its radius of 0\.65 m fits .* faces of \w+, even at rest, since only"),
        ({"sphere": above(1.2)}, r"faces of \w+, at a stretch of 1\.7, since only .* edge is 1 m at rest; faces"),
        ({"sphere": above(0.65), "faces": "auto"}, None),
        (FALLING, r"^sphere 0: may move 0\.33 m in a substep, more than its radius of 0\.3 m"),
        (FALLING | {"contact": "impulse"}, None),  # its path is swept
    ],
)
def test_a_sphere_that_fits_through_a_face_or_jumps_over_particles_is_named(fields: dict, sentence: str | None):
    cubes = {"balloon": [Balloon(mesh=cube())], "gravity": 0.0, "faces": False}
    warnings = plan_model(Scene(**fields if "balloon" in fields else cubes | fields)).warnings
    assert len(warnings) == (sentence is not None)
    assert sentence is None or re.search(sentence, warnings[0])


def test_the_smallest_sphere_of_all_worlds_counts():
    sphere = Sphere(position=(0.0, 5.0, 0.0), radius=2.0)
    scene = Scene(balloon=[Balloon(mesh=cube())], sphere=[sphere], gravity=0.0, faces=False)
    plan = plan_model(scene, 3, vary={"sphere.0.radius": np.array([2.0, 0.5, 3.0])})
    assert plan.warnings[0].startswith("sphere 0: its radius of 0.5 m fits through")


@pytest.mark.parametrize("name", bundled_scenes())
def test_bundled_scenes_hold_their_spheres(name):
    assert plan_model(load_scene(name)).warnings == []

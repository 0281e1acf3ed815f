"""Wind that grows with height, and gusts, as a field; drag of balloons in the air, and lift and drag of their faces."""

from functools import cache

import numpy as np
import pytest
import warp as wp
from gas_balloons import NO_SPRINGS, advanced
from meshes import cube, grid, quad_sphere
from numpy.typing import NDArray

from balloon_warp import Atmosphere, Balloon, Change, Inflation, InputError, Scene, Simulator
from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.laws.air import drag_bound, waves, wind_at
from balloon_warp.model import build_model

wp.set_module_options(OPTIONS)

WIND, LENGTH, INTENSITY = (6.0, 0.0, 2.0), 5.0, 0.3
ROOT_MEAN_SQUARE = INTENSITY * float(np.linalg.norm(WIND))
RANDOM = np.random.default_rng(3)


@wp.kernel
def blow(
    places: wp.array[wp.vec3],
    time: float,
    seed: float,
    shear: float,
    roughness: float,
    intensity: float,
    wind: wp.vec3,
    air: wp.array[wp.vec3],
):
    i = wp.tid()
    air[i] = wind_at(places[i], wp.vec3(0.0, 1.0, 0.0), time, wind, shear, 10.0, roughness, intensity, 5.0, seed)


def gusts(places: NDArray, device: str, time: float = 0.0, seed: float = 0.0) -> NDArray[np.float64]:
    """Return gusts over their root mean square, shape (count, 3)."""
    velocities = air_around(places, device, time, seed=seed, intensity=INTENSITY)
    return (velocities - WIND) / ROOT_MEAN_SQUARE


def air_around(
    places: NDArray, device: str, time: float = 0.0, seed: float = 0.0, **profile: float
) -> NDArray[np.float64]:
    """Return the velocity of the air [m/s], shape (count, 3)."""
    shape = [profile.get(name, 0.0) for name in ("shear", "roughness", "intensity")]
    there = wp.array(places.astype(np.float32), dtype=wp.vec3, device=device)
    air = wp.zeros(len(places), dtype=wp.vec3, device=device)
    wp.launch(blow, len(places), inputs=[there, time, seed, *shape, wp.vec3(*WIND), air], device=device)
    return air.numpy().astype(np.float64)


@cache
def spread(count: int) -> NDArray[np.float64]:
    """Return places in a box of 200 lengths."""
    return RANDOM.uniform(-100.0 * LENGTH, 100.0 * LENGTH, (count, 3))


@pytest.mark.always
def test_waves_are_of_von_karman_s_spectrum():
    """Shells of three at right angles, from 28 lengths to a 300th, whose energies follow the spectrum over even steps
    in the logarithm of k; the mean square of a wave is 0.50033."""
    vectors, amplitudes = np.array(waves()).transpose(1, 0, 2).reshape(2, 16, 3, 3)
    numbers, strengths = (np.linalg.norm(each, axis=2) for each in (vectors, amplitudes))
    for axes in (vectors / numbers[..., None], amplitudes / strengths[..., None]):
        np.testing.assert_allclose(axes @ axes.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (16, 3, 3)), atol=1e-12)
    np.testing.assert_allclose((vectors * amplitudes).sum(axis=2), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.diff(np.log(numbers.ravel())), np.log(240 * 28) / 45.0, rtol=0.01)
    np.testing.assert_allclose([1.0 / numbers[0, 1], numbers[15, 1], numbers.max()], [28.0, 240.0, 300.0], rtol=0.05)
    k = numbers[:, 1] * 2.0 * np.pi * 1.339
    shares = k**5 / (1.0 + k**2) ** (17.0 / 6.0)
    np.testing.assert_allclose(strengths**2, np.tile(shares / shares.sum() / 0.50033, (3, 1)).T, rtol=1e-12)
    assert (
        np.abs(vectors[1:] / numbers[1:, :, None] - vectors[:-1] / numbers[:-1, :, None]).max(axis=(1, 2)).min() > 0.1
    )


def test_gusts_have_no_mean_and_the_variance_that_they_are_given(device: str):
    """Some 20,000 of 40,000 places are independent: a mean is off by 0.007, a mean square by 0.01, each over that."""
    found = gusts(spread(40_000), device)
    np.testing.assert_allclose(found.mean(axis=0), 0.0, atol=0.03)
    np.testing.assert_allclose(np.cov(found.T), np.eye(3), atol=0.04)


@pytest.mark.always("cpu")
def test_gusts_have_no_divergence(device: str):
    """Differences over a five-thousandth of a length, a fifteenth of the shortest wave, which float32 resolves."""
    places, step = RANDOM.uniform(-2.0, 2.0, (4000, 3)), 1e-4 * LENGTH
    sides = [[gusts(places + way * axis, device) for way in (-step, step)] for axis in np.eye(3)]
    slopes = [(after - before) / (2.0 * step) for before, after in sides]
    divergence = sum(slope[:, axis] for axis, slope in enumerate(slopes))
    assert np.sqrt(np.mean(divergence**2)) < 0.02 * np.sqrt(np.mean(slopes[0] ** 2))


def structure(apart: float, device: str) -> tuple[float, float]:
    """Return structure functions: mean squares of differences so far apart [lengths], along the line and across."""
    directions = RANDOM.normal(size=(40_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    places = spread(40_000)
    differences = gusts(places + apart * LENGTH * directions, device) - gusts(places, device)
    along = np.einsum("ij,ij->i", differences, directions)
    return float(np.mean(along**2)), float(((differences**2).sum(axis=1).mean() - np.mean(along**2)) / 2.0)


def test_small_gusts_follow_kolmogorov(device: str):
    """Structure functions grow with the distance to the 2/3 from a fortieth of the gusts' length to a fifth,
    Kolmogorov's spectrum of -5/3: within 0.03 over all, and within 0.1 for each doubling, in which shells of waves that
    are 0.85 octaves apart show. They are 4/3 as large across as along."""
    distances = 0.025 * 2.0 ** np.arange(4)
    found = np.array([structure(apart, device) for apart in distances])
    both = found[:, 0] + 2.0 * found[:, 1]
    slopes = np.diff(np.log(both)) / np.log(2.0)
    assert slopes.mean() == pytest.approx(2.0 / 3.0, abs=0.03)
    np.testing.assert_allclose(slopes, 2.0 / 3.0, atol=0.1)
    assert np.mean(found[:, 1] / found[:, 0]) == pytest.approx(4.0 / 3.0, rel=0.06)


def test_gusts_belong_together_over_their_length(device: str):
    """The integral of the longitudinal correlation is the length."""
    distances = np.linspace(0.0, 8.0, 33)
    correlation = [1.0 - structure(apart, device)[0] / 2.0 for apart in distances[1:]]
    assert np.trapezoid([1.0, *correlation], distances) == pytest.approx(1.0, rel=0.1)


def test_the_wind_carries_gusts_along(device: str):
    """Gusts move with the wind by Taylor's hypothesis: those here now were upwind before."""
    places = RANDOM.uniform(-2.0, 2.0, (500, 3))
    # float32 knows 20 m to a millionth of them, and the shortest waves, which are weak, are 1.7 cm
    carried = gusts(places + 3.0 * np.array(WIND), device, time=3.0)
    np.testing.assert_allclose(carried, gusts(places, device), atol=1e-3)
    assert np.abs(gusts(places, device, time=3.0) - gusts(places, device)).max() > 1.0


def test_wind_grows_with_height_by_the_power_law_and_the_logarithm(device: str):
    """Wind is zero at the ground, or at the roughness length, the given one at 10 m, and constant above 100 m."""
    heights = np.array([-1.0, 0.0, 0.03, 0.3, 1.0, 10.0, 40.0, 100.0, 300.0])
    known = np.clip(heights, 0.0, 100.0)
    logarithm = np.log(np.clip(heights, 0.03, 100.0) / 0.03) / np.log(10.0 / 0.03)
    for profile, growth in (({"shear": 0.25}, (known / 10.0) ** 0.25), ({"roughness": 0.03}, logarithm)):
        found = air_around(heights[:, None] * (0.0, 1.0, 0.0), device, **profile)
        np.testing.assert_allclose(found, growth[:, None] * WIND, rtol=1e-5, atol=1e-6)


@pytest.mark.always
def test_the_step_allows_for_the_fastest_wind():
    """Drag is density, coefficient and area times the speed through the air, in the strongest gust, ten times as high
    as the wind is told of, and there no faster."""
    areas, rng = np.array([1.0]), np.random.default_rng(1)
    velocities, wind = rng.normal(size=(5, 3)), rng.normal(size=(5, 3))
    speeds, winds = np.linalg.norm(velocities - wind, axis=1), np.linalg.norm(wind, axis=1)
    air = (101325.0, 288.15, 1.3, 0.4, wind)
    for shear, gusts in ((0.0, 0.0), (0.2, 0.0), (0.2, 0.5)):
        most = speeds + (10.0**shear - 1.0 + 4.0 * gusts) * winds
        np.testing.assert_allclose(drag_bound(2.0, velocities, *air, shear, 10.0, 0.0, gusts), 1.3 * 0.4 * 2.0 * most)
    for roughness in (2e-4, 0.03, 1.0, 9.0):
        known = (np.zeros((1, 3)), 101325.0, 288.15, 1.0, 1.0, np.array([[7.0, 0.0, 0.0]]), 0.0, 10.0, roughness, 0.0)
        fastest = 7.0 * np.log(100.0 / roughness) / np.log(10.0 / roughness)
        assert fastest <= float(drag_bound(areas, *known)[0]) < 1.1 * fastest


def test_worlds_have_winds_of_their_own(device: str):
    leaf = Balloon(mesh=cube(), mass=0.01, face_drag=1.0, **STILL)
    air = Atmosphere(wind=(3.0, 0.0, 0.0), gusts=0.3, shear=0.2)
    scene = Scene(balloon=[leaf], atmosphere=air, gravity=0.0)
    vary = {"atmosphere.gust_seed": [1, 2, 1, 1], "atmosphere.gusts": [0.3, 0.3, 0.3, 0.0]}
    simulator = Simulator(scene, device, 4, vary)
    advanced(simulator, 3)
    first, other, same, calm = simulator.state.velocities.numpy()[0:4]
    np.testing.assert_array_equal(first, same)
    assert np.abs(first - other).max() > 0.1
    assert np.abs(calm[:, 1:]).max() < 1e-3 < 0.05 < np.abs(first[:, 1:]).max()


STILL = {"stiffness": NO_SPRINGS, "damping": 0.0, "inflation": Inflation(kind="pressure", pressure=0.0)}


def test_drag_is_part_of_the_stable_step(device):
    """A storm carries a light cube away as with steps an eighth as long, and never faster than itself."""
    light = Balloon(mesh=cube(), mass=0.05, drag_coefficient=1.0, inflation=Inflation(k_normal=0.0))
    calm = Scene(balloon=[light], gravity=0.0, atmosphere=Atmosphere(density=1.2))
    storm = calm.model_copy(update={"atmosphere": Atmosphere(density=1.2, wind=(30.0, 0.0, 0.0))})
    few, enough = build_model(calm, device).substeps, build_model(storm, device).substeps
    assert enough > 10 * few
    speeds = []
    for substeps in (enough, 8 * enough):
        simulator = Simulator(storm.model_copy(update={"substeps": substeps}), device)
        advanced(simulator, 3)
        speeds.append(simulator.state.velocities.numpy()[0, :, 0].mean())
        assert 27.0 < advanced(simulator, 57).velocities[0][:, 0].mean() < 30.0
    assert speeds[0] == pytest.approx(speeds[1], rel=0.02)  # first order in a step that is an 80th of these frames
    with pytest.raises(InputError, match=f"substeps: {few} are too few"):
        Simulator(storm.model_copy(update={"substeps": few}), device)
    gust = storm.model_copy(update={"substeps": few, "atmosphere": calm.atmosphere})
    with pytest.raises(InputError, match=f"substeps: {few} are too few"):
        Simulator(gust.model_copy(update={"change": [Change(time=0.1, set={"atmosphere.wind.0": 30.0})]}), device)


def forces_on(device: str, balloon: Balloon, air: Atmosphere) -> np.ndarray:
    """Return the net forces on particles at the start [N]."""
    scene = Scene(balloon=[balloon], gravity=0.0, atmosphere=air, net_forces=True)
    return Simulator(scene, device).read_frame().net_forces[0].astype(np.float64)


@pytest.mark.always("cpu-90.0")
@pytest.mark.parametrize("angle", [10.0, 45.0, 90.0])
def test_a_plate_at_an_angle_has_lift_and_drag(angle: float, device: str):
    """1/2 rho A C_n u^2 sin a along its normal, and 1/2 rho A C_t u^2 cos a along itself."""
    plate = Balloon(mesh=grid(3, 2), rotation=(0.0, angle, 0.0), face_drag=1.2, face_friction=0.05, **STILL)
    lift_axis = np.array([0.0, 0.0, 1.0])
    force = forces_on(device, plate, Atmosphere(density=1.3, wind=(5.0, 0.0, 0.0))).sum(axis=0)
    sine, cosine = np.sin(np.radians(angle)), np.cos(np.radians(angle))
    unit = 0.5 * 1.3 * 6.0 * 5.0**2
    assert force[0] == pytest.approx(unit * (1.2 * sine * sine + 0.05 * cosine * cosine), rel=1e-4)
    assert abs(force @ lift_axis) == pytest.approx(unit * (1.2 - 0.05) * sine * cosine, rel=1e-4, abs=1e-3)
    assert force[1] == pytest.approx(0.0, abs=1e-3)


PAPERS, ON_FACES = {"drag_coefficient": 0.47}, {"face_drag": 0.3, "face_friction": 0.05}


@pytest.mark.parametrize(
    ("size", "drag", "coefficient", "within"),
    [
        *((size, PAPERS, 0.47, 1.0 / size**2) for size in (3, 6, 12)),
        (12, {"face_drag": 0.3}, 4.0 / 3.0 * 0.3, 0.015),
        (12, {"face_friction": 0.2}, 8.0 / 3.0 * 0.2, 0.015),
        (12, ON_FACES, 4.0 / 3.0 * 0.3 + 8.0 / 3.0 * 0.05, 0.015),
    ],
)
def test_drag_on_a_sphere_is_the_textbooks(size: int, drag: dict, coefficient: float, within: float, device: str):
    """1/2 rho C_d pi R^2 u^2 beside the wind, with C_d = 4/3 C_n + 8/3 C_t of faces, up to the mesh's edges squared."""
    air, relative = Atmosphere(density=1.3, wind=(0.0, 0.0, 2.0)), np.array([-3.0, 4.0, 1.0])
    ball = Balloon(mesh=quad_sphere(size, 0.2), velocity=tuple(air.wind - relative), **drag, **STILL)
    expected = 0.5 * 1.3 * coefficient * np.pi * 0.2**2 * np.linalg.norm(relative) * relative
    force = forces_on(device, ball, air).sum(axis=0)
    np.testing.assert_allclose(force, expected, atol=within * np.linalg.norm(expected))
    along = ball.model_copy(update={"velocity": air.wind})
    np.testing.assert_array_equal(forces_on(device, along, air), 0.0)

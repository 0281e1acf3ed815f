"""Wind that grows with height, and gusts: as a field, and its force on balloons."""

from functools import cache

import numpy as np
import pytest
import warp as wp
from gas_balloons import NO_SPRINGS, advanced
from meshes import cube
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.air import drag_bound, wind_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.model import plan_model
from balloon_warp.scene import Atmosphere, Balloon, Inflation, Scene
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

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
    places: NDArray,
    device: str,
    time: float = 0.0,
    *,
    seed: float = 0.0,
    shear: float = 0.0,
    roughness: float = 0.0,
    intensity: float = 0.0,
) -> NDArray[np.float64]:
    """Return the velocity of the air [m/s], shape (count, 3)."""
    there = wp.array(places.astype(np.float32), dtype=wp.vec3, device=device)
    air = wp.zeros(len(places), dtype=wp.vec3, device=device)
    wp.launch(
        blow, len(places), inputs=[there, time, seed, shear, roughness, intensity, wp.vec3(*WIND), air], device=device
    )
    return air.numpy().astype(np.float64)


@cache
def spread(count: int) -> NDArray[np.float64]:
    """Return places in a box of 200 lengths."""
    return RANDOM.uniform(-100.0 * LENGTH, 100.0 * LENGTH, (count, 3))


def test_gusts_have_no_mean_and_the_variance_that_they_are_given(device: str):
    """Gusts have zero mean and the given variance, isotropic and independent. Of 40,000 places some 20,000 are
    independent: a mean is off by 0.007, a mean square by 0.01, each four times over."""
    found = gusts(spread(40_000), device)
    np.testing.assert_allclose(found.mean(axis=0), 0.0, atol=0.03)
    np.testing.assert_allclose(np.cov(found.T), np.eye(3), atol=0.04)


def test_gusts_have_no_divergence(device: str):
    """The divergence is small beside the gusts' gradients, by differences over a five-thousandth of a length, a
    fifteenth of the shortest wave, which float32 resolves to a thousandth."""
    places, step = RANDOM.uniform(-2.0, 2.0, (4000, 3)), 1e-4 * LENGTH
    slopes = [
        (gusts(places + step * axis, device) - gusts(places - step * axis, device)) / (2.0 * step) for axis in np.eye(3)
    ]
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
    """Gusts move with the wind by Taylor's hypothesis: what is here now was upwind before."""
    places = RANDOM.uniform(-2.0, 2.0, (500, 3))
    np.testing.assert_allclose(
        gusts(places + 3.0 * np.array(WIND), device, time=3.0), gusts(places, device), atol=1e-3
    )  # float32 knows 20 m to a millionth of them, and the shortest waves, which are weak, are 1.7 cm
    assert np.abs(gusts(places, device, time=3.0) - gusts(places, device)).max() > 1.0


def test_a_seed_is_a_wind(device: str):
    places = RANDOM.uniform(-2.0, 2.0, (500, 3))
    once, again, other = (gusts(places, device, seed=seed) for seed in (4.0, 4.0, 5.0))
    np.testing.assert_array_equal(once, again)
    assert np.abs(once - other).max() > 1.0


def test_wind_grows_with_height_by_the_power_law(device: str):
    """Wind follows the power law: zero at the ground, the given one at 10 m, and constant above 100 m."""
    places = np.array([(0.0, height, 0.0) for height in (-1.0, 0.0, 1.0, 10.0, 40.0, 300.0)])
    found = air_around(places, device, shear=0.25)
    expected = np.outer([0.0, 0.0, 0.1**0.25, 1.0, 4.0**0.25, 10.0**0.25], WIND)
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_wind_grows_with_height_by_the_logarithm(device: str):
    """Wind follows the logarithmic law: zero at the roughness length, constant above 100 m."""
    heights = np.array([-1.0, 0.0, 0.03, 0.3, 10.0, 40.0, 100.0, 300.0])
    found = air_around(heights[:, None] * (0.0, 1.0, 0.0), device, roughness=0.03)
    growth = np.log(np.clip(heights, 0.03, 100.0) / 0.03) / np.log(10.0 / 0.03)
    np.testing.assert_allclose(found, growth[:, None] * WIND, rtol=1e-5, atol=1e-6)


def test_the_step_allows_for_the_fastest_wind():
    """The step's bound is the wind at ten times the height, no more than a tenth too fast."""
    areas = np.array([1.0])
    for roughness in (2e-4, 0.03, 1.0, 9.0):
        known = (np.zeros((1, 3)), 101325.0, 288.15, 1.0, 1.0, np.array([[7.0, 0.0, 0.0]]), 0.0, 10.0, roughness, 0.0)
        fastest = 7.0 * np.log(100.0 / roughness) / np.log(10.0 / roughness)
        assert fastest <= float(drag_bound(areas, *known)[0]) < 1.1 * fastest


def test_worlds_have_winds_of_their_own(schedule: str, device: str):
    """Equal seeds give bit-identical winds, and other seeds other drifts; stronger gusts shake more."""
    leaf = Balloon(
        mesh=cube(), mass=0.01, stiffness=NO_SPRINGS, damping=0.0, face_drag=1.0, inflation=Inflation(pressure=0)
    )
    air = Atmosphere(wind=(3.0, 0.0, 0.0), gusts=0.3, shear=0.2)
    scene = Scene(balloon=[leaf], atmosphere=air, gravity=0.0)
    vary = {"atmosphere.gust_seed": [1, 2, 1, 1], "atmosphere.gusts": [0.3, 0.3, 0.3, 0.0]}
    simulator = Simulator(scene, device, 4, vary, schedule=schedule)
    advanced(simulator, 3)
    first, other, same, calm = simulator.state.velocities.numpy()[0:4]
    np.testing.assert_array_equal(first, same)
    assert np.abs(first - other).max() > 0.1
    assert np.abs(calm[:, 1:]).max() < 1e-3 < 0.05 < np.abs(first[:, 1:]).max()


def test_mistakes_of_the_wind_are_said():
    balloon = Balloon(mesh=cube(), inflation=Inflation(pressure=0))
    for fields, vary, sentence in (
        ({"roughness": 0.1, "shear": 0.2}, None, "roughness: gives another wind profile than shear"),
        ({"roughness": 10.0}, None, r"roughness: must be less than wind_height, 10 m \(got 10\)"),
        ({"roughness": 0.1}, {"atmosphere.wind_height": [10.0, 0.05]}, r"less than wind_height, 0.05 m \(got 0.1\)"),
    ):
        with pytest.raises(InputError, match=sentence):
            plan_model(Scene(balloon=[balloon], atmosphere=Atmosphere(**fields)), 2, vary)
    with pytest.raises(InputError, match=r"atmosphere.gusts: must be"):
        Atmosphere(gusts=-0.1)
    with pytest.raises(InputError, match=r"atmosphere.gust_seed: must be a whole number|gust_seed"):
        Atmosphere(gust_seed=1.5)

"""Buoyancy, added mass and thin air; wind that grows with height, gusts, and the drag and lift of faces."""
# pyright: reportGeneralTypeIssues=false

from dataclasses import replace
from functools import cache
from typing import Any, Literal

import numpy as np
import pytest
import warp as wp
from conserved import advanced
from gas_balloons import NO_SPRINGS, displaced, gas_balloon, isentropic, set_state, volume_of, wet_part, with_volume
from law_functions import LAWS
from meshes import cube, grid, prism, quad_sphere, torus
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.air import drag_bound, waves, wind_at
from balloon_warp.kernels.phases.inflation import find_lift
from balloon_warp.kernels.tables import Tables
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.load import place_mesh
from balloon_warp.mesh.topology import signed_volume
from balloon_warp.model import build_model
from balloon_warp.scene import Atmosphere, Balloon, Change, Inflation, Scene, Stiffness, Tube, Water
from balloon_warp.simulator import Simulator

PARTY = with_volume(quad_sphere(3), np.pi / 6.0 * 0.28**3)
"""28 cm"""
SHORT = {"frames_per_second": 200.0, "substeps": 8}


def test_helium_lifts_by_the_difference_of_densities(device: str):
    """A helium balloon of 28 cm lifts 11.93 g, straight up, and without a torque about the center."""
    mesh = with_volume(quad_sphere(4), np.pi / 6.0 * 0.28**3)
    scene = Scene(balloon=[gas_balloon(mesh, mass=0.003)], net_forces=True)
    simulator = Simulator(scene, device)
    forces = simulator.read_frame().net_forces[0].astype(np.float64)
    lifted = forces.sum(axis=0) / 9.81 + [0.0, 0.003, 0.0]
    np.testing.assert_allclose(lifted, [0.0, 11.93e-3, 0.0], atol=5e-6)
    np.testing.assert_allclose(np.cross(mesh.points, forces).sum(axis=0), 0.0, atol=1e-6)


def test_density_follows_pressure_and_temperature_where_the_scene_says_none(device: str):
    """Density follows the ideal gas law per world: half the pressure at the same temperature is half the density, of
    air and gas, at the start and on the device a step later."""
    mesh = with_volume(quad_sphere(3), 0.01)
    scene = Scene(balloon=[gas_balloon(mesh, mass=0.003)], net_forces=True, frames_per_second=1e6, substeps=1)
    vary = {"atmosphere.pressure": [101325.0, 50662.5, 101325.0], "atmosphere.temperature": [293.15, 293.15, 586.3]}
    simulator = Simulator(scene, device, 3, vary)
    for _ in range(2):
        lifted = [simulator.read_frame(world).net_forces[0][:, 1].sum() / 9.81 + 0.003 for world in range(3)]
        np.testing.assert_allclose(lifted, [10.377e-3, 5.189e-3, 5.189e-3], rtol=1e-3)
        simulator.step()


def accelerations(simulator: Simulator, frames: int = 1) -> list[float]:
    """Return the mean upward acceleration of each world from rest [m/s^2]."""
    advanced(simulator, frames)
    velocities = simulator.state.velocities.numpy()[:, :, 1].astype(np.float64)
    return (velocities.mean(axis=1) * simulator.model.scene.frames_per_second / frames).tolist()


def test_a_party_balloon_starts_at_the_textbooks_acceleration(device: str):
    """The acceleration is (rho V - m - n M) g over m + n M + c rho V: 7.40 m/s^2, and 17.82 without added mass, which
    has no weight; and that of air in air as dense as it, or in denser. The tolerance is rounding of a gas's 1e5 Pa."""
    scene = Scene(balloon=[gas_balloon(PARTY, {"added_mass": 0.5}, mass=0.003)], **SHORT)
    parts, densities = [0.5, 0.0, 1.0, 0.0], [1.2041, 1.2041, 1.5, 1.2041]
    molar_masses = [0.0040026, 0.0040026, 0.0040026, 0.0289652]
    vary = {"added_mass": parts, "molar_mass": molar_masses}
    vary = {f"balloon.0.inflation.{name}": values for name, values in vary.items()} | {"atmosphere.density": densities}
    simulator = Simulator(scene, device, 4, vary)
    volume = np.pi / 6.0 * 0.28**3
    expected = []
    for part, rho, molar_mass in zip(parts, densities, molar_masses, strict=True):
        gas = volume / 0.0240548 * molar_mass
        expected.append((rho * volume - 0.003 - gas) * 9.81 / (0.003 + gas + part * rho * volume))
    assert expected[:2] == pytest.approx([7.40, 17.82], rel=1e-3)
    np.testing.assert_allclose(accelerations(simulator), expected, rtol=2e-3)


HEIGHTS = [0.0, -400.0, 3000.0, 9000.0]
LAPSES = [0.0, 0.0065, 0.0065, 0.0]
GRAVITY, GAS_CONSTANT, AIR_MASS = 9.80665, 8.314462618, 0.0289652


def standard_air(height: float, lapse: float) -> tuple[float, float, float]:
    """Return pressure [Pa], temperature [K] and density [kg/m^3] of standard air, from 101,325 Pa and 288.15 K."""
    temperature = 288.15 - lapse * height
    if lapse:
        pressure = 101325.0 * (temperature / 288.15) ** (GRAVITY * AIR_MASS / (GAS_CONSTANT * lapse))
    else:
        pressure = 101325.0 * np.exp(-GRAVITY * AIR_MASS * height / (GAS_CONSTANT * 288.15))
    return pressure, temperature, pressure * AIR_MASS / (GAS_CONSTANT * temperature)


def test_buoyancy_falls_with_height(device: str):
    """A weather balloon of 10 m with 100 kg starts with its net lift over the mass that moves. Float32 resolves a
    balloon at 9,000 m to a ten-thousandth of its size, so the tolerance is 2%."""
    balloon = gas_balloon(quad_sphere(3, 5.0), {"added_mass": 0.5, "gamma": 1.4}, mass=100.0)
    air = Atmosphere(pressure=101325.0, temperature=288.15, lapse=0.0)
    scene = Scene(balloon=[balloon], atmosphere=air, gravity=GRAVITY, frames_per_second=20.0, substeps=10)
    vary = {"balloon.0.position.1": HEIGHTS, "atmosphere.lapse": LAPSES}
    simulator = Simulator(scene, device, len(HEIGHTS), vary)
    volume = volume_of(simulator, simulator.read_frame())
    expected = []
    for height, lapse in zip(HEIGHTS, LAPSES, strict=True):
        pressure, temperature, density = standard_air(height, lapse)
        gas = pressure * volume / (GAS_CONSTANT * temperature) * 0.0040026
        expected.append((density * volume - 100.0 - gas) * GRAVITY / (100.0 + gas + 0.5 * density * volume))
    assert max(expected) > 1.5 * min(expected)
    np.testing.assert_allclose(accelerations(simulator), expected, rtol=0.02)
    # in balance with the air around it, of 31,000 Pa and more
    assert abs(simulator.state.pressures.numpy()).max() < 100.0


@pytest.mark.parametrize("gamma", [1.0, 1.4])
def test_a_gas_that_is_carried_up_presses_more(gamma: float, device: str):
    """Gas at 3,000 m presses by the amount of its fill at 1,000 m, cooled with the air or not. The balloon is too heavy
    to expand in a millisecond, and its amount of gas balances the air at 1,000 m."""
    (low, warm, _), (high, cold, _) = standard_air(1000.0, 0.0065), standard_air(3000.0, 0.0065)
    ball = quad_sphere(3, 5.0)
    amount = low * signed_volume(ball) / (GAS_CONSTANT * warm)
    balloon = gas_balloon(ball, {"gamma": gamma, "amount": amount}, mass=1e7, position=(0.0, 1000.0, 0.0))
    air = Atmosphere(temperature=288.15, lapse=0.0065)
    scene = Scene(balloon=[balloon], atmosphere=air, gravity=GRAVITY, frames_per_second=1000.0, substeps=1)
    simulator = Simulator(scene, device)
    assert simulator.state.pressures.numpy()[0, 0] == pytest.approx(0.0, abs=1.0)
    advanced(simulator, 1)
    quantized = 1e-4 * high  # how well float32 knows the volume at such a height
    assert simulator.state.pressures.numpy()[0, 0] == pytest.approx(0.0, abs=quantized)
    points = simulator.state.points.numpy()[0]
    set_state(simulator, points=points + (0.0, 2000.0, 0.0), velocities=np.zeros_like(points))
    advanced(simulator, 1)
    expected = low * (cold / warm if gamma == 1.0 else 1.0) - high
    assert expected > 10_000.0
    assert simulator.state.pressures.numpy()[0, 0] == pytest.approx(expected, abs=4.0 * quantized)


def test_drag_follows_the_density(device: str):
    """Drag on a cube in a wind of 10 m/s falls with the density from the ground to 3,000 m."""
    box = Balloon(mesh=cube(), drag_coefficient=1.0, damping=0.0, inflation=Inflation(pressure=0.0))
    air = Atmosphere(temperature=288.15, lapse=0.0065, wind=(10.0, 0.0, 0.0))
    scene = Scene(balloon=[box], atmosphere=air, gravity=GRAVITY, net_forces=True)
    simulator = Simulator(scene, device, 2, {"balloon.0.position.1": [0.0, 3000.0]})
    low, high = (simulator.read_frame(world).net_forces[0].sum(axis=0)[0] for world in range(2))
    assert high / low == pytest.approx(standard_air(3000.0, 0.0065)[2] / standard_air(0.0, 0.0)[2], rel=1e-3)


def aloft(gamma: float) -> Scene:
    """Return rigid balloons of 1 m: one is pumped, one is filled with litres, one leaks helium, and two are joined."""
    ball, gas = quad_sphere(3, 1.0), {"start_pressure": 2000.0, "gamma": gamma}
    kinds = ({"pump": 2.0}, {"litres": 5.0, "fill_time": 0.02}, {"leak": 1e-3}, {"start_pressure": 8000.0}, {})
    balloons = [
        gas_balloon(ball, {**gas, **kind}, mass=1e9, position=(4.0 * number, 0.0, 0.0))
        for number, kind in enumerate(kinds)
    ]
    air = Atmosphere(temperature=288.15, lapse=0.0065)
    tube = Tube(balloons=(3, 4), conductance=1e-3)
    return Scene(
        balloon=balloons, tube=[tube], atmosphere=air, gravity=GRAVITY, frames_per_second=1000.0, substeps=2, frames=20
    )


@pytest.mark.parametrize("gamma", [1.0, 1.4])
def test_gas_meets_the_air_at_its_height(gamma: float, device: str):
    """Flows of gas use the air at the balloon's height. Pumped gas has its temperature, V_0 = (R T / p_0) (p_0 / p)^(1
    - 1 / gamma) a mole at the pressure p in full; litres are litres of it; a leak follows its density, rho C A root(2 p
    / rho); and a tube conserves p_1 V + p_2 V. At 3,000 m each would be off by 3 % and more with the air at height 0.
    Float32's volumes give the pressures to a ten-thousandth."""
    heights = [0.0, 3000.0]
    vary = {f"balloon.{number}.position.1": heights for number in range(5)}
    simulator = Simulator(aloft(gamma), device, 2, vary)
    volume = signed_volume(quad_sphere(3, 1.0))
    before = simulator.state.gas_amounts.numpy().copy(), simulator.state.free_volumes.numpy().copy()
    advanced(simulator, 20)
    amounts, free_volumes = simulator.state.gas_amounts.numpy(), simulator.state.free_volumes.numpy()
    pressures, flows = simulator.state.pressures.numpy(), simulator.state.vent_flows.numpy()
    for world, height in enumerate(heights):
        outside, temperature, _ = standard_air(height, 0.0065)
        more, grown = (after[world] - old[world] for after, old in zip((amounts, free_volumes), before, strict=True))
        assert more[0] == pytest.approx(0.04, rel=1e-6)
        assert more[1] == pytest.approx(0.005 * outside / (GAS_CONSTANT * temperature), rel=5e-4)
        warm = temperature if gamma != 1.0 else 288.15  # where heat passes, told as at height 0
        a_mole = GAS_CONSTANT * warm / 101325.0 * (101325.0 / (outside + 2000.0)) ** (1.0 - 1.0 / gamma)
        np.testing.assert_allclose(grown[:2], more[:2] * a_mole, rtol=1e-3)
        density = 0.0040026 * amounts[world, 2] / volume
        gone = 1e-3 * isentropic(pressures[world, 2], density, max(gamma, 1.4), outside)[0] / 0.0040026
        assert flows[world, 2] == pytest.approx(gone, rel=1e-3)
        assert more[4] > 1e-3
        if gamma == 1.0:
            np.testing.assert_allclose(free_volumes[world], amounts[world] * a_mole, rtol=1e-5)
        else:
            inside = 101325.0 * (free_volumes[world] / volume) ** gamma
            assert inside[3:].sum() == pytest.approx(2.0 * outside + 10_000.0, abs=2.0)
            np.testing.assert_allclose(inside, outside + pressures[world], rtol=3e-4)


G, RHO = 9.81, 1000.0
LIMP = {"stiffness": NO_SPRINGS, "inflation": Inflation(k_normal=0.0), "damping": 0.0}
"""without springs, inflation or damping"""


def limp(mesh: PolygonMesh, water: Water, **fields) -> Scene:
    """Return a mesh on which only weight and water act."""
    return Scene(balloon=[Balloon(mesh=mesh, **LIMP, **fields)], water=water, net_forces=True, frames=1)


def push_of_water(mesh: PolygonMesh, level: float, device: str, **fields) -> tuple[np.ndarray, np.ndarray]:
    """Return the force [N], and torque [N m] about the origin, of the water on a mesh at rest."""
    simulator = Simulator(limp(mesh, Water(level=level), mass=1e-3, **fields), device)
    frame = simulator.read_frame()
    points = frame.points[0].astype(np.float64)
    forces = frame.net_forces[0].astype(np.float64) + [0.0, 1e-3 * G / len(points), 0.0]
    return forces.sum(axis=0), np.cross(points, forces).sum(axis=0)


@pytest.mark.always("cpu-ball--0.6")
@pytest.mark.parametrize("level", [-0.6, -0.1, 0.0, 0.37, 5.0])
@pytest.mark.parametrize("mesh", [quad_sphere(5), prism(7), torus(12, 7)], ids=["ball", "prism", "torus"])
def test_force_and_torque_are_those_of_the_displaced_water(mesh, level, device):
    """Archimedes' force rho g V acts at the center of the displaced volume; for quads that are not flat, and 7-gons."""
    turned = place_mesh(mesh, "Y", 1.0, (20.0, 40.0, 70.0), (0.1, 0.2, -0.3))
    volume, center = displaced(turned, level)
    force, torque = push_of_water(turned, level, device)
    lift = np.array([0.0, RHO * G * volume, 0.0])
    scale = RHO * G * max(abs(level), 1.0)  # of the pressure, of which float32 keeps seven digits
    np.testing.assert_allclose(force, lift, atol=1e-5 * scale)
    np.testing.assert_allclose(torque, np.cross(center, lift), atol=1e-5 * scale)


def test_drag_acts_at_the_center_of_the_wetted_area(device):
    """Drag on a moving prism acts at the center of its wetted area as trimesh cuts it, shared among particles."""
    turned = place_mesh(prism(7), "Y", 1.0, (20.0, 40.0, 70.0), (0.1, 0.2, -0.3))
    wet = wet_part(turned, 0.1)
    scene = limp(turned, Water(level=0.1), velocity=(0.0, 0.0, 2.0)).model_copy(update={"gravity": 0.0})
    frame = Simulator(scene, device).read_frame()
    force = np.array([0.0, 0.0, -0.5 * RHO * wet.area * 4.0])
    np.testing.assert_allclose(frame.net_forces[0].sum(axis=0), force, rtol=1e-5)
    torque = np.cross(frame.points[0], frame.net_forces[0]).sum(axis=0)
    np.testing.assert_allclose(torque, np.cross(wet.centroid, force), atol=1e-5 * wet.area * RHO)


@pytest.mark.parametrize("substeps", [1, 16])
@pytest.mark.parametrize(
    ("start", "helium"), [(0.0, 5.0), (0.03, 5.0), (3.0, 5.0), (3.0, 0.0)], ids=["from rest", "slow", "fast", "free"]
)
def test_drag_goes_as_its_solution_does_whatever_the_step(start: float, helium: float, substeps: int, device):
    """A force F takes a speed v to u (v + u T) / (u + v T), with u = root(2 F / rho c A) and T = tanh(F t / m u),
    though a step is twenty times as long as m u / F; without it to v / (1 + k v t) with k = rho c A / 2 m."""
    mass = 2.0
    scene = limp(cube(), Water(level=99.0, drag=1.0), mass=mass, helium=helium, velocity=(0.0, start, 0.0))
    scene = scene.model_copy(update={"gravity": 0.0, "substeps": substeps, "frames_per_second": 10.0})
    simulator = Simulator(scene, device)
    terminal = np.sqrt(2.0 * mass * helium / (RHO * 6.0))
    for frame in (1, 2, 3):
        if helium:
            grown = np.tanh(0.1 * frame * helium / terminal)
            expected = terminal * (start + terminal * grown) / (terminal + start * grown)
        else:
            expected = start / (1.0 + 0.5 * RHO * 6.0 / mass * start * 0.1 * frame)
        np.testing.assert_allclose(simulator.step().velocities[0][:, 1], expected, rtol=1e-4)


@pytest.mark.parametrize("substeps", ["auto", 128])
def test_a_light_ball_rises_at_its_terminal_speed(substeps: Literal["auto"] | int, device):
    """A ball of gas rises by the volume that it has then at root(2 F / rho c A), F the lift without the weight."""
    mesh, mass = quad_sphere(3, 0.15), 0.05
    gas = {"start_pressure": 300.0, "molar_mass": 0.0, "added_mass": 0.0}
    firm = Stiffness(structural=1000.0, shear=500.0, flexion=50.0)
    balloon = gas_balloon(mesh, gas, mass=mass, position=(0.0, -3.0, 0.0), stiffness=firm)
    simulator = Simulator(Scene(balloon=[balloon], water=Water(level=0.0), substeps=substeps), device)
    heights = [simulator.step().points[0][:, 1].mean() for _ in range(16)]
    frame = simulator.read_frame()
    area = wet_part(replace(mesh, points=frame.points[0].astype(np.float64)), 0.0).area
    expected = np.sqrt(2.0 * G * (RHO * volume_of(simulator, frame) - mass) / (RHO * area))
    assert (heights[15] - heights[7]) / (8.0 / 60.0) == pytest.approx(expected, rel=0.002)


def test_a_floating_block_bobs_at_its_natural_frequency(device):
    """A stiff cube half as dense as water bobs at omega^2 = rho g A / m, A its waterline."""
    mass, lifted = 500.0, 0.02
    stiff = Stiffness(structural=2e7, shear=2e7, flexion=2e7)
    balloon = Balloon(mesh=cube(), position=(0.0, lifted - 0.5, 0.0), mass=mass, **(LIMP | {"stiffness": stiff}))
    simulator = Simulator(Scene(balloon=[balloon], water=Water(drag=0.0), frames_per_second=240.0), device)
    quarter_period = 0.5 * np.pi / np.sqrt(RHO * G / mass)
    heights = []
    while len(heights) < 240 * 1.2 * quarter_period:
        heights.append(simulator.read_frame().points[0][:, 1].mean())
        simulator.step()
    crossing = np.interp(0.0, -np.array(heights), np.arange(len(heights)) / 240.0)
    assert crossing == pytest.approx(quarter_period, rel=0.003)  # the bottom is pressed in by 0.1 mm


def test_the_step_is_stable_on_water(device):
    """The step is stable on water for a sheet without springs, at most 1 kg / 9 over 1/4 m^2, or 0.44 mm, deep. Its
    particles bob at 297 / s, for which a frame of 1/60 s in one step would be too long; with steps fifty times as short
    they rise by 2.3 mm."""
    sheet = Balloon(mesh=grid(2, 2), rotation=(90.0, 0.0, 0.0), position=(0.0, -0.0002, 0.0), mass=1.0, **LIMP)
    simulator = Simulator(Scene(balloon=[sheet], water=Water(drag=0.0)), device)
    assert max(np.abs(simulator.step().points[0][:, 1]).max() for _ in range(60)) < 4.0e-3


WIND, LENGTH, INTENSITY = (6.0, 0.0, 2.0), 5.0, 0.3
ROOT_MEAN_SQUARE = INTENSITY * float(np.linalg.norm(WIND))
RANDOM = np.random.default_rng(3)


@wp.kernel(enable_backward=False, module=LAWS)
def blow(
    places: wp.array[wp.vec3], time: float, seed: float, shear: float, roughness: float, intensity: float,
    wind: wp.vec3, air: wp.array[wp.vec3],
):  # fmt: skip
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


NOTHING: Any = None
lift_of = find_lift.make(NOTHING, NOTHING)  # which has no choice


@wp.struct
class OfParticle:
    share: float


@wp.kernel(enable_backward=False, module=LAWS)
def lift_along(t: Tables, loads: wp.array[wp.vec4], found: wp.array[float]):
    i = wp.tid()
    found[i] = lift_of(t, OfParticle(), wp.vec3(), wp.vec3(), loads[i])[0]


@pytest.mark.always
@pytest.mark.parametrize("up", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_displaced_water_lifts_along_whichever_axis_is_up(up: tuple[float, float, float], device: str):
    loads, t = np.random.default_rng(2).normal(size=(8, 4)), Tables()
    t.up, found = wp.vec3(*up), wp.zeros(len(loads), dtype=float, device=device)
    wp.launch(lift_along, len(loads), [t, wp.array(loads, dtype=wp.vec4, device=device), found], device=device)
    np.testing.assert_allclose(found.numpy(), -loads[:, :3] @ np.array(up), rtol=1e-6)


@pytest.mark.parametrize(("level", "wet_area"), [(9.0, 6.0), (0.25, 2.0), (-1.0, 0.0)])
def test_drag_follows_the_wetted_area(level: float, wet_area: float, device):
    """Drag is 1/2 rho c A v^2 against the motion of a cube with the bottom and a quarter of each side wet."""
    scene = limp(cube(), Water(level=level, drag=0.7), mass=2.0, velocity=(3.0, 0.0, 0.0))
    simulator = Simulator(scene.model_copy(update={"gravity": 0.0}), device)
    force = simulator.read_frame().net_forces[0].sum(axis=0)
    np.testing.assert_allclose(force, [-0.5 * RHO * 0.7 * wet_area * 9.0, 0.0, 0.0], rtol=1e-5)


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

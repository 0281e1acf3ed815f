"""Pressure and sealed gas, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from gas_balloons import (
    AIR_PRESSURE,
    GAS_CONSTANT,
    NO_SPRINGS,
    PRESSURE_ROUNDING,
    TEMPERATURE,
    advanced,
    gas_balloon,
    jittered,
    octahedron,
    set_state,
    volume_of,
    with_volume,
)
from meshes import cube, prism, quad_sphere, torus
from scipy.integrate import solve_ivp
from trajectories import after_frames

from balloon_warp.kernels.laws.air import ALIKE
from balloon_warp.kernels.laws.gas import Swelling, gas_load
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.scene import Balloon, Ground, Inflation, Scene, Sphere, Stiffness
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

wp.set_module_options(OPTIONS)


def test_a_frame_whose_forces_nobody_asks_for_computes_none(monkeypatch):
    """A frame computes no forces unless asked: their kernels would dominate the first frame's wait."""
    balloon = Balloon(mesh=octahedron(), inflation=Inflation(kind="pressure", pressure=7.0))
    simulator = Simulator(Scene(balloon=[balloon]), "cpu")
    launched = []
    monkeypatch.setattr(wp, "launch", lambda kernel, *args, **more: launched.append(kernel))
    frame = simulator.read_frame()
    assert not launched
    assert frame.is_finite
    assert not frame.net_forces
    assert not frame.inflation_forces


@pytest.mark.full
@pytest.mark.parametrize(
    "mesh", [jittered(prism(5)), jittered(quad_sphere(3)), octahedron()], ids=["prism", "ball", "octahedron"]
)
def test_pressure_force_is_the_gradient_of_the_volume(mesh: PolygonMesh, device: str):
    """Pressure forces agree with central differences of the volume, of second order in a step of 1e-4 m."""
    balloon = Balloon(mesh=mesh, stiffness=NO_SPRINGS, inflation=Inflation(kind="pressure", pressure=7.0))
    scene = Scene(balloon=[balloon], gravity=0.0, frames_per_second=1e6, substeps=1, net_forces=True)
    simulator = Simulator(scene, device)
    forces = advanced(simulator, 1).inflation_forces[0]
    expected = np.zeros_like(mesh.points)
    for particle in range(mesh.vertex_count):
        for axis in range(3):
            volumes = []
            for step in (1e-4, -1e-4):
                points = mesh.points.copy()
                points[particle, axis] += step
                volumes.append(signed_volume(replace(mesh, points=points)))
            expected[particle, axis] = 7.0 * (volumes[0] - volumes[1]) / 2e-4
    np.testing.assert_allclose(forces, expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.full
@pytest.mark.parametrize("mesh", [jittered(torus(9, 6)), jittered(prism(7))], ids=["torus", "prism"])
def test_net_pressure_force_and_torque_vanish_on_a_closed_mesh(mesh: PolygonMesh, device: str):
    """Net force and torque of pressure vanish to float32's rounding; the paper's normal forces miss by a hundredth."""
    forces = {}
    for kind, value in (("pressure", {"pressure": 100.0}), ("normal_force", {"k_normal": 1.0})):
        balloon = Balloon(mesh=mesh, stiffness=NO_SPRINGS, inflation=Inflation(kind=kind, **value))
        scene = Scene(balloon=[balloon], gravity=0.0, frames_per_second=1e6, substeps=1, net_forces=True)
        simulator = Simulator(scene, device)
        forces[kind] = advanced(simulator, 1).inflation_forces[0].astype(np.float64)

    def imbalance(of: np.ndarray) -> list[float]:
        total = np.linalg.norm(of, axis=1).sum()
        torque = np.cross(mesh.points, of).sum(axis=0)
        return [float(np.linalg.norm(sum_) / total) for sum_ in (of.sum(axis=0), torque)]

    assert max(imbalance(forces["pressure"])) < 1e-6
    assert max(imbalance(forces["normal_force"])) > 1e-3


def test_a_sealed_gas_has_the_pressure_of_its_volume(device: str):
    """The ideal gas law holds: 1.406598 mol in 0.0335103 m^3 at 20 C press by 984.375 Pa, at the start and later."""
    mesh = with_volume(quad_sphere(4), 0.0335103)
    balloon = gas_balloon(mesh, {"amount": 1.406598}, fixed=list(range(mesh.vertex_count)))
    simulator = Simulator(Scene(balloon=[balloon], frames=2), device)
    for _ in range(2):
        np.testing.assert_allclose(simulator.read_frame().pressures, [984.375], atol=PRESSURE_ROUNDING)
        simulator.step()


@pytest.mark.parametrize("gamma", [1.0, 1.4])
def test_a_gas_squeezed_by_a_sphere_follows_p_v_gamma(gamma: float, device: str):
    """A gas squeezed adiabatically between a heavy sphere and the ground follows p V^gamma, up to the step's lag."""
    rubber = Stiffness(structural=300.0, shear=150.0, flexion=50.0)
    balloon = gas_balloon(
        quad_sphere(4, 0.2), {"gamma": gamma}, position=(0.0, 0.21, 0.0), stiffness=rubber, damping=5.0, mass=0.1
    )
    press = Sphere(position=(0.0, 0.61, 0.0), radius=0.2, mass=60.0)
    simulator = Simulator(Scene(balloon=[balloon], sphere=[press], ground=Ground(), frames=20), device)
    frames = list(simulator.run())
    volumes = np.array([volume_of(simulator, frame) for frame in frames])
    pressures = np.array([AIR_PRESSURE + frame.pressures[0] for frame in frames])
    assert volumes.min() < 0.985 * volumes[0]
    np.testing.assert_allclose(pressures * volumes**gamma, AIR_PRESSURE * volumes[0] ** gamma, rtol=1e-3)
    assert pressures.max() > (1.0 / 0.985) ** gamma * AIR_PRESSURE


@pytest.mark.parametrize("stretch", [1.3, 1.7, 2.0, 2.4, 3.5])
def test_a_balloon_of_springs_is_in_balance_on_its_pressure_curve(stretch: float, device: str):
    """A balloon at the stretch l is in equilibrium at p = sum(k L0^2) (l - 1) / (3 V0 l^2), and shrinks with a
    twentieth less pressure."""
    mesh, k = octahedron(0.1), 40.0
    v0, springs = signed_volume(mesh), 12 * k * 2.0 * 0.1**2
    pressure = springs * (stretch - 1.0) / (3.0 * v0 * stretch**2)

    def stretch_at_rest(pressure: float) -> float:
        amount = (AIR_PRESSURE + pressure) * stretch**3 * v0 / (GAS_CONSTANT * TEMPERATURE)
        rubber = Stiffness(structural=k, shear=0.0, flexion=0.0)
        balloon = gas_balloon(mesh, {"amount": amount, "molar_mass": 0.0}, stiffness=rubber, damping=1.0, mass=0.02)
        scene = Scene(balloon=[balloon], gravity=0.0, frames=20)
        simulator = Simulator(scene, device)
        set_state(simulator, points=stretch * mesh.points)
        frame = advanced(simulator, 20)
        at_rest = np.cbrt(volume_of(simulator, frame) / v0)
        expected = springs * (at_rest - 1.0) / (3.0 * v0 * at_rest**2)
        np.testing.assert_allclose(frame.pressures[0], expected, atol=PRESSURE_ROUNDING)
        return at_rest

    assert pressure > 20 * PRESSURE_ROUNDING
    np.testing.assert_allclose(stretch_at_rest(pressure), stretch, rtol=1e-6)
    assert stretch_at_rest(0.95 * pressure) < stretch * (1.0 - 1e-5)


def test_a_given_pressure_follows_its_keyframes_within_a_frame(device: str):
    """Keyframes of the pressure are interpolated within a frame: the last of four substeps begins at three quarters."""
    given = Inflation(kind="pressure", pressure=[(0.0, 20.0), (0.2, 100.0)])
    balloon = Balloon(mesh=cube(), inflation=given, fixed=list(range(8)))
    simulator = Simulator(Scene(balloon=[balloon], frames_per_second=10, substeps=4), device)
    pressures = [float(advanced(simulator, 1).pressures[0]) for _ in range(3)]
    np.testing.assert_allclose(pressures, [50.0, 90.0, 100.0], rtol=1e-6)


def test_the_pressure_curve_peaks_at_twice_the_size(device: str):
    """The pressure peaks at sum(k L0^2) / (12 V0), found by pumping past it in a second."""
    mesh, k = octahedron(0.1), 40.0
    v0, springs = signed_volume(mesh), 12 * k * 2.0 * 0.1**2
    rubber = Stiffness(structural=k, shear=0.0, flexion=0.0)
    balloon = gas_balloon(mesh, {"pump": 1.0}, stiffness=rubber, damping=2.0, mass=0.02)
    simulator = Simulator(Scene(balloon=[balloon], gravity=0.0), device)
    frames = [advanced(simulator, 1) for _ in range(60)]
    sizes = np.array([np.cbrt(volume_of(simulator, frame) / v0) for frame in frames])
    pressures = np.array([frame.pressures[0] for frame in frames])
    assert sizes[0] < 1.3 < 2.5 < sizes[-1]
    peak = pressures.argmax()
    # it is being pumped, slowly enough to be nearly at rest, against some damping
    np.testing.assert_allclose(sizes[peak], 2.0, atol=0.1)
    np.testing.assert_allclose(pressures[peak], springs / (12.0 * v0), rtol=0.02)


def test_the_step_is_the_springs_and_yet_the_gas_is_stable(device: str):
    """The implicit gas is stable at the springs' step, though a 3 g, 28 cm balloon breathes at 2.5 kHz."""
    soft = Stiffness(structural=5.0, shear=2.0, flexion=1.0)
    balloon = gas_balloon(quad_sphere(4, 0.14), {"start_pressure": 200.0}, stiffness=soft, mass=0.003)
    simulator = Simulator(Scene(balloon=[balloon], gravity=0.0), device)
    assert simulator.model.step_seconds > 4 * 1.3e-4
    kick = np.random.default_rng(2).normal(0.0, 0.02, (simulator.model.particle_count, 3))
    set_state(simulator, velocities=kick)
    assert np.std(advanced(simulator, 60).velocities[0]) < 2.0 * np.std(kick)


@wp.kernel
def _find_load(
    swelling: wp.array[Swelling], free_volume: float, gamma: float, step_seconds: float, load: wp.array[wp.vec4]
):
    """Store the load of a mole of helium in the air of a room."""
    place = wp.tid()
    load[place] = gas_load(
        swelling[place],
        1.0,
        free_volume,
        step_seconds,
        gamma,
        1.0,
        0.004,
        AIR_PRESSURE,
        TEMPERATURE,
        1.2,
        ALIKE,
        9.81,
    )


@pytest.mark.parametrize("gamma", [1.0, 1.4])
def test_the_pressure_is_that_of_the_volume_at_the_end_of_the_step(gamma: float, device: str):
    """The pressure is implicit: that at the end of the step, to first order, with its rise with height."""
    step, free_volume = 5e-4, 0.024
    volume, response, rate, height, response_height = swelling = (0.02, 30.0 * step, 0.3, 2.0, 75.0 * step)
    load = wp.zeros(1, dtype=wp.vec4, device=device)
    given = wp.array([swelling], dtype=Swelling, device=device)
    wp.launch(_find_load, 1, inputs=[given, free_volume, gamma, step, load], device=device)
    pressure, at_zero, rise, _ = load.numpy()[0].astype(np.float64)

    def law(volume: float) -> float:
        return AIR_PRESSURE * ((free_volume / volume) ** gamma - 1.0)

    slope = (law(volume * 1.0001) - law(volume * 0.9999)) / (0.0002 * volume)
    pushed = response * pressure + rise * (response_height - height * response)
    np.testing.assert_allclose(pressure, law(volume) + slope * step * (rate + pushed), atol=PRESSURE_ROUNDING)
    np.testing.assert_allclose(rise, (1.2 - 0.004 / volume) * 9.81, rtol=1e-5)
    np.testing.assert_allclose(at_zero, pressure - rise * height, rtol=1e-5)


def test_breathing_converges_to_the_gas_law(device: str):
    """Kinetic energy of a round balloon, 1/2 sum m r'^2, grows by p dV, at first order in the step."""
    mesh, mass, start = octahedron(0.1), 0.01, 3000.0
    v0 = signed_volume(mesh)

    def acceleration(_: float, state: np.ndarray) -> list[float]:
        size, speed = state
        pressure = (AIR_PRESSURE + start) * size ** (-3 * 1.4) - AIR_PRESSURE
        return [speed, pressure * 3.0 * v0 * size**2 / (mass * 0.1**2)]

    seconds = 1e-3
    exact = solve_ivp(acceleration, (0.0, seconds), [1.0, 0.0], rtol=1e-10, atol=1e-12).y[0, -1]

    def error(substeps: int) -> float:
        gas = {"start_pressure": start, "gamma": 1.4, "molar_mass": 0.0}
        scene = Scene(
            balloon=[gas_balloon(mesh, gas, mass=mass)], gravity=0.0, frames_per_second=1000, substeps=substeps
        )
        points = advanced(Simulator(scene, device), 1).points[0]
        return float(np.linalg.norm(points, axis=1).mean() / 0.1 - exact)

    errors = np.array([error(substeps) for substeps in (50, 100, 200)])
    assert abs(exact - 1.0) > 0.005
    np.testing.assert_allclose(errors[:-1] / errors[1:], 2.0, atol=0.3)


@pytest.mark.full
def test_a_balloon_of_many_particles_swells_as_the_sum_of_its_parts(device: str):
    """Sums of more than 2,048 particles agree to rounding: `gather` makes them in parts, `block` does not."""
    sealed = Balloon(mesh=quad_sphere(20, 0.5), inflation={"kind": "gas", "start_pressure": 200.0})
    found = []
    for schedule in ("gather", "block"):
        simulator = Simulator(Scene(balloon=[sealed], frames_per_second=240.0), device, schedule=schedule)
        simulator.step()
        found.append((simulator.state.pressures.numpy()[0, 0], simulator.state.points.numpy()[0]))
    assert found[0][0] == pytest.approx(found[1][0], abs=PRESSURE_ROUNDING)
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=0, atol=1e-5)


def test_a_pump_that_is_switched_on_later_pumps(schedule, device: str):
    """A pump switched on later pumps: kernels leave out unused features, so the schedule is rebuilt."""
    sealed = Balloon(mesh=quad_sphere(3, 0.5), inflation={"kind": "gas", "start_pressure": 200.0})
    simulator = Simulator(Scene(balloon=[sealed]), device, schedule=schedule)
    simulator.step()
    before = simulator.state.gas_amounts.numpy()[0, 0]
    simulator.set_parameters({"keyframe_values": np.full((1, 1, 1), 0.6)})
    simulator.step()
    gained = simulator.state.gas_amounts.numpy()[0, 0] - before
    assert gained == pytest.approx(0.6 * simulator.model.frame_seconds, rel=1e-6)


def test_a_solid_that_is_far_away_changes_no_bit(schedule, device: str):
    """A distant solid, present or yet to appear, leaves the gas bit-identical, so that a recording of the page replays.
    The rate of swelling, which looks for solids, must not add and subtract the old pressure: that would round it."""
    ball = Balloon(mesh=jittered(torus(6, 5), 0.02), inflation=Inflation(kind="gas", start_pressure=300.0))
    alone = Scene(balloon=[ball], gravity=0.0, substeps=8)
    beside = alone.model_copy(update={"sphere": [Sphere(position=(0.0, 90.0, 0.0), radius=5.0)]})
    first, second = (after_frames(scene, schedule, device, 6).state.points.numpy() for scene in (alone, beside))
    assert np.abs(first - Simulator(alone, device).state.points.numpy()).max() > 1e-4
    np.testing.assert_array_equal(first, second)

"""Breathing mode of a balloon on its gas, damped by the step or not, against the theory of either scheme."""

import numpy as np
import pytest
from gas_balloons import AIR_PRESSURE, gas_balloon, octahedron, set_state
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.scene import Scene
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

RADIUS, MASS, GAMMA = 0.1, 0.01, 1.4
MESH = octahedron(RADIUS)
VOLUME = signed_volume(MESH)
OMEGA = float(np.sqrt(GAMMA * AIR_PRESSURE / VOLUME * (3.0 * VOLUME / RADIUS) ** 2 / MASS))
"""of its breathing [1/s]: dp/dV times (dV/dr)^2 over its mass"""


def swing(breathing_damping: float, phase_of_step: float, periods: float, schedule: str = "scatter") -> NDArray:
    """Return the excess size after each step over that at rest; it starts 0.1% too large.

    Args: phase_of_step: omega h."""
    gas = {"gamma": GAMMA, "molar_mass": 0.0, "breathing_damping": breathing_damping}
    scene = Scene(
        balloon=[gas_balloon(MESH, gas, mass=MASS)],
        gravity=0.0,
        frames_per_second=OMEGA / phase_of_step,
        substeps=1,
    )
    simulator = Simulator(scene, "cpu", schedule=schedule)
    set_state(simulator, points=1.001 * MESH.points)
    sizes = []
    for _ in range(int(np.ceil(periods * 2.0 * np.pi / phase_of_step))):
        simulator.step()
        sizes.append(float(np.linalg.norm(simulator.read_frame().points[0].astype(np.float64), axis=1).mean()) / RADIUS)
    return np.array(sizes) - 1.0


def phase_of(swing: NDArray) -> float:
    """Return the phase advance of a step: x_(n+1) + x_(n-1) = 2 cos(phase) x_n."""
    around = swing[2:] + swing[:-2]
    return float(np.arccos(0.5 * around @ swing[1:-1] / (swing[1:-1] @ swing[1:-1])))


def amplitude(swing: NDArray, phase: float) -> float:
    """Return the amplitude of the best-fitting oscillation."""
    angles = phase * np.arange(len(swing))
    waves = np.stack([np.cos(angles), np.sin(angles), np.ones_like(angles)], axis=1)
    return float(np.hypot(*np.linalg.lstsq(waves, swing, rcond=None)[0][:2]))


def test_an_undamped_balloon_breathes_on(schedule: str, device: str):
    """An undamped balloon keeps its amplitude for 20 periods, at the frequency of the trapezoidal rule, up to the gas
    law's nonlinearity at a swing of a thousandth."""
    if device != "cpu":
        pytest.skip("the schedules are what differs")
    found = swing(0.0, 0.83, 22, schedule)
    expected = 2.0 * np.arctan(0.83 / 2.0)
    np.testing.assert_allclose(phase_of(found), expected, rtol=1e-3)
    first, last = (amplitude(part, expected) for part in (found[:16], found[-16:]))
    assert first > 0.9e-3
    np.testing.assert_allclose(last, first, rtol=0.01)


@pytest.mark.full
def test_a_balloon_breathes_on_in_steps_as_long_as_its_breath():
    """The swing at omega h = 8 flips from step to step and stays bounded: from rest, half a step after the velocity
    that it gets at once, it reaches root(1 + (omega h)^2 / 4) of where it began."""
    found = swing(0.0, 8.0, 200)
    np.testing.assert_allclose(phase_of(found), 2.0 * np.arctan(4.0), rtol=1e-3)
    widest = 1e-3 * np.sqrt(1.0 + 8.0**2 / 4.0)
    np.testing.assert_allclose([np.abs(found).max(), np.abs(found[-30:]).max()], widest, rtol=0.05)


def test_the_default_is_damped_as_by_backward_euler():
    """Backward Euler damps the square of the swing by 1 / (1 + (omega h)^2) a step: nothing is left of five periods."""
    found = swing(1.0, 0.83, 5)
    assert np.abs(found[-8:]).max() < 1e-3 * np.abs(found[0])
    slow = swing(1.0, 0.1, 3)
    phase = phase_of(slow / (1.0 + 0.01) ** (-0.5 * np.arange(len(slow))))
    parts = [amplitude(part / 1.01 ** (-0.5 * np.arange(63)), phase) for part in (slow[:63], slow[63:126])]
    np.testing.assert_allclose(parts[1] / parts[0], 1.01 ** (-0.5 * 63), rtol=0.02)


def test_what_is_between_damps_in_between():
    swings = [np.abs(swing(damping, 0.83, 4)[-8:]).max() for damping in (0.0, 0.02, 0.1, 1.0)]
    assert (np.diff(swings) < -0.1 * np.array(swings[:-1])).all()


def test_the_undamped_frequency_is_right_to_second_order():
    """The error of the phase omega h - 2 atan(omega h / 2) is (omega h)^3 / 12: the frequency's is of second order."""
    errors = np.array([phase / phase_of(swing(0.0, phase, 4)) - 1.0 for phase in (0.8, 0.4, 0.2)])
    np.testing.assert_allclose(errors[:-1] / errors[1:], 4.0, rtol=0.15)


def test_its_damping_may_change_while_it_runs():
    """A change of the damping while it runs takes effect, by other kernels."""
    simulator = Simulator(Scene(balloon=[gas_balloon(MESH, {"molar_mass": 0.0}, mass=MASS)], gravity=0.0), "cpu")
    undamped = Simulator(
        Scene(balloon=[gas_balloon(MESH, {"molar_mass": 0.0, "breathing_damping": 0.0}, mass=MASS)], gravity=0.0), "cpu"
    )
    simulator.set_parameters({"breathing_damping": [[0.0]]})
    for each in (simulator, undamped):
        set_state(each, points=1.001 * MESH.points)
        for _ in range(3):
            each.step()
    np.testing.assert_array_equal(simulator.state.points.numpy(), undamped.state.points.numpy())
    assert np.abs(simulator.state.velocities.numpy()).max() > 0.01

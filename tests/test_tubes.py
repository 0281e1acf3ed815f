"""Gas that is pumped, let out, and goes through tubes."""

import numpy as np
import pytest
from gas_balloons import AIR_PRESSURE, GAS_CONSTANT, PRESSURE_ROUNDING, TEMPERATURE, advanced, gas_balloon, with_volume
from meshes import cube

from balloon_warp.scene import Scene, Tube
from balloon_warp.simulator import Simulator


def test_gas_is_pumped_by_its_keyframes_and_let_out_to_the_last(device: str):
    """The integral of what is linear between keyframes; nothing is left to let out after that."""
    fixed = list(range(8))
    balloon = gas_balloon(cube(), {"amount": 1.0, "pump": [(0.0, 0.0), (0.2, 1.0), (0.4, -40.0)]}, fixed=fixed)
    simulator = Simulator(Scene(balloon=[balloon], frames_per_second=10, substeps=7), device)
    amounts = [float(advanced(simulator, 1).gas_amounts[0]) for _ in range(6)]
    np.testing.assert_allclose(amounts[:2], [1.025, 1.1], rtol=1e-6)
    np.testing.assert_allclose(amounts[2:], [1.1 + 0.05 * (1.0 - 19.5), 0.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(simulator.read_frame().pressures, -AIR_PRESSURE, rtol=1e-6)


@pytest.mark.parametrize("conductance", [1e-5, 1.0])
def test_a_tube_evens_out_pressures_and_loses_nothing(conductance: float, device: str):
    """Two rigid balloons: the difference fades at C (dp1/dn1 + dp2/dn2), or at once through a wide tube."""
    rigid = [with_volume(cube(), 0.02), with_volume(cube(), 0.05)]
    starts = [2000.0, 500.0]
    balloons = [
        gas_balloon(mesh, {"start_pressure": start}, fixed=list(range(8)))
        for mesh, start in zip(rigid, starts, strict=True)
    ]
    tube = Tube(balloons=(0, 1), conductance=conductance)
    simulator = Simulator(Scene(balloon=balloons, tube=[tube], substeps=200, frames_per_second=10), device)
    before = simulator.read_frame()
    after = advanced(simulator, 1)
    np.testing.assert_allclose(after.gas_amounts.sum(), before.gas_amounts.sum(), rtol=1e-12)
    rate = conductance * GAS_CONSTANT * TEMPERATURE * (1.0 / 0.02 + 1.0 / 0.05)
    expected = 1500.0 * np.exp(-rate * 0.1)
    # the step's error is rate * h / 2 of the exponent
    np.testing.assert_allclose(-np.diff(after.pressures)[0], expected, rtol=0.01, atol=2 * PRESSURE_ROUNDING)


def test_tube_flows_between_worlds_differ(device: str):
    balloons = [gas_balloon(cube(), {"start_pressure": start}, fixed=list(range(8))) for start in (100.0, 0.0)]
    scene = Scene(balloon=balloons, tube=[Tube(balloons=(0, 1), conductance=0.0)])
    simulator = Simulator(scene, device, 2, {"tube.conductance": [0.0, 1.0]})
    advanced(simulator, 3)
    pressures = simulator.state.pressures.numpy()
    np.testing.assert_allclose(pressures, [[100.0, 0.0], [50.0, 50.0]], atol=3 * PRESSURE_ROUNDING)

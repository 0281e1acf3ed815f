"""Adiabatic and isothermal gas against thermodynamics: when the air changes, when gas is pumped, let out, and goes
through a tube."""

import numpy as np
import pytest
from gas_balloons import (
    AIR_PRESSURE,
    GAS_CONSTANT,
    PRESSURE_ROUNDING,
    TEMPERATURE,
    advanced,
    gas_balloon,
    volume_of,
    with_volume,
)
from meshes import cube, quad_sphere

from balloon_warp.scene import Balloon, Change, Scene, Stiffness, Tube
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

GAMMA = 1.4
AT_ONCE = 1 / 60
"""a frame after the start [s]"""


def in_balloon(gamma: float, changed: dict[str, float]) -> Simulator:
    """Return a soft balloon, strongly damped, around which the air changes after a frame."""
    rubber = Stiffness(structural=20.0, shear=10.0, flexion=5.0)
    gas = {"gamma": gamma, "start_pressure": 300.0}
    balloon = gas_balloon(quad_sphere(3, 0.2), gas, stiffness=rubber, mass=0.05, damping=2.0)
    scene = Scene(balloon=[balloon], gravity=0.0, change=[Change(time=AT_ONCE, set=changed)])
    return Simulator(scene, "cpu")


def tank(volume: float, gas: dict) -> Balloon:
    """Return a rigid tank."""
    return gas_balloon(with_volume(cube(), volume), {"gamma": GAMMA, **gas}, fixed=list(range(8)))


@pytest.mark.parametrize("gamma", [1.2, 1.4])
def test_p_v_gamma_stays_when_the_air_s_pressure_falls(gamma: float):
    """Gas expands along its adiabat when the air's pressure falls by a tenth, where p V^gamma once grew."""
    simulator = in_balloon(gamma, {"atmosphere.pressure": 0.9 * AIR_PRESSURE})
    before = simulator.read_frame()
    after = advanced(simulator, 90)
    volumes = [volume_of(simulator, frame) for frame in (before, after)]
    pressures = [AIR_PRESSURE + before.pressures[0], 0.9 * AIR_PRESSURE + after.pressures[0]]
    assert volumes[1] > 1.05 * volumes[0]
    invariant = np.array(pressures, dtype=np.float64) * np.array(volumes) ** gamma
    np.testing.assert_allclose(invariant[1], invariant[0], rtol=1e-5)


def test_p_v_stays_when_the_air_s_pressure_falls_and_heat_passes():
    simulator = in_balloon(1.0, {"atmosphere.pressure": 0.9 * AIR_PRESSURE})
    amount = simulator.read_frame().gas_amounts[0]
    frame = advanced(simulator, 90)
    inside = 0.9 * AIR_PRESSURE + frame.pressures[0]
    np.testing.assert_allclose(inside * volume_of(simulator, frame), amount * GAS_CONSTANT * TEMPERATURE, rtol=1e-5)


@pytest.mark.parametrize(("gamma", "warmth"), [(1.0, 1.1), (1.4, 1.0)])
def test_the_air_s_warmth_reaches_only_gas_that_heat_passes_to(gamma: float, warmth: float):
    """Air a tenth warmer expands isothermal gas by p V = n R T and leaves adiabatic gas alone."""
    simulator = in_balloon(gamma, {"atmosphere.temperature": 1.1 * TEMPERATURE})
    amount = simulator.read_frame().gas_amounts[0]
    frame = advanced(simulator, 90)
    at_rest = advanced(in_balloon(gamma, {"atmosphere.temperature": TEMPERATURE}), 90)
    inside = AIR_PRESSURE + frame.pressures[0]
    if warmth == 1.0:
        np.testing.assert_array_equal(frame.points[0], at_rest.points[0])
    else:
        held = amount * GAS_CONSTANT * warmth * TEMPERATURE
        np.testing.assert_allclose(inside * volume_of(simulator, frame), held, rtol=1e-5)
        assert volume_of(simulator, frame) > 1.05 * volume_of(simulator, at_rest)


def test_a_tank_that_is_filled_gains_gamma_r_t_with_each_mole(device: str):
    """A tank that is filled gains V dp = gamma R T dn: the gas brings its enthalpy at the air's temperature. A tank
    that empties expands adiabatically: p / n^gamma is constant."""
    pump = [(0.0, 4.0), (0.2, 4.0), (0.3, -4.0)]
    scene = Scene(balloon=[tank(0.02, {"pump": pump})], frames_per_second=10, substeps=200)
    simulator = Simulator(scene, device)
    empty = simulator.read_frame()
    full = advanced(simulator, 2)
    moles = full.gas_amounts[0] - empty.gas_amounts[0]
    np.testing.assert_allclose(moles, 0.8, rtol=1e-6)
    gained = GAMMA * GAS_CONSTANT * TEMPERATURE * moles / 0.02
    # of 400 steps each presses what came in at its start by half a step's part too little
    np.testing.assert_allclose(full.pressures[0] - empty.pressures[0], gained, rtol=0.3 / 400)
    full, after = advanced(simulator, 1), advanced(simulator, 1)
    assert after.gas_amounts[0] < 0.8 * full.gas_amounts[0]
    inside = [AIR_PRESSURE + float(frame.pressures[0]) for frame in (full, after)]
    left = (after.gas_amounts[0] / full.gas_amounts[0]) ** GAMMA
    np.testing.assert_allclose(inside[1] / inside[0], left, rtol=1e-6)


def test_a_tank_that_fills_another_keeps_the_energy(device: str, schedule: str):
    """Two tanks conserve energy, p V / (gamma - 1) of both: no heat, no work. The filling one expands adiabatically, n
    / n' = (p / p')^(1 / gamma): it cools, and the other ends warmer than both were."""
    volumes = np.array([0.02, 0.05])
    tanks = [tank(0.02, {"start_pressure": 20000.0}), tank(0.05, {})]
    tube = Tube(balloons=(0, 1), conductance=1e-4)
    scene = Scene(balloon=tanks, tube=[tube], frames_per_second=10, substeps=100, touch=False)
    simulator = Simulator(scene, device, schedule=schedule)
    before, after = simulator.read_frame(), advanced(simulator, 6)
    inside = [AIR_PRESSURE + frame.pressures.astype(np.float64) for frame in (before, after)]
    np.testing.assert_allclose(inside[1], inside[0] @ volumes / volumes.sum(), atol=3.0)
    left = after.gas_amounts[0] / before.gas_amounts[0]
    np.testing.assert_allclose(left, (inside[1][0] / inside[0][0]) ** (1.0 / GAMMA), rtol=1e-5)
    warmth = inside[1] * volumes / (after.gas_amounts * GAS_CONSTANT)
    assert warmth[0] < TEMPERATURE - 5.0 < TEMPERATURE + 2.0 < warmth[1]


@pytest.mark.parametrize("gammas", [(1.0, 1.4), (1.4, 1.1)])
def test_another_gamma_begins_at_the_pressure_that_there_is(gammas: tuple[float, float]):
    change = Change(time=AT_ONCE, set={"balloon.inflation.gamma": gammas[1], "atmosphere.pressure": AIR_PRESSURE - 500})
    start = {"start_pressure": 20000.0, "gamma": gammas[0]}
    simulator = Simulator(Scene(balloon=[tank(0.02, start)], change=[change]), "cpu")
    np.testing.assert_allclose(advanced(simulator, 3).pressures, 20500.0, atol=PRESSURE_ROUNDING)

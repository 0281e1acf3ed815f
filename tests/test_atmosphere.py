"""Air whose pressure and density fall with height."""

import numpy as np
import pytest
from gas_balloons import advanced, gas_balloon, set_state, volume_of
from meshes import cube, quad_sphere

from balloon_warp.errors import InputError
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.scene import Atmosphere, Balloon, Change, Inflation, Scene, Tube
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

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


def test_the_standard_atmosphere_is_the_standard_atmosphere():
    """The reference formula gives the tabulated 70,109 Pa and 0.9093 kg/m^3 at 3,000 m."""
    assert standard_air(3000.0, 0.0065) == pytest.approx((70109.0, 268.65, 0.9093), rel=1e-3)


def test_buoyancy_falls_with_height(schedule: str, device: str):
    """A weather balloon of 10 m with 100 kg starts with its net lift over the mass that moves. Float32 resolves a
    balloon at 9,000 m to a ten-thousandth of its size, so the tolerance is 2%."""
    balloon = gas_balloon(quad_sphere(3, 5.0), {"added_mass": 0.5, "gamma": 1.4}, mass=100.0)
    air = Atmosphere(pressure=101325.0, temperature=288.15, lapse=0.0)
    scene = Scene(balloon=[balloon], atmosphere=air, gravity=GRAVITY, frames_per_second=20.0, substeps=10)
    vary = {"balloon.0.position.1": HEIGHTS, "atmosphere.lapse": LAPSES}
    simulator = Simulator(scene, device, len(HEIGHTS), vary, schedule=schedule)
    volume = volume_of(simulator, simulator.read_frame())
    simulator.step()
    speeds = simulator.state.velocities.numpy()[:, :, 1].astype(np.float64).mean(axis=1)
    expected = []
    for height, lapse in zip(HEIGHTS, LAPSES, strict=True):
        pressure, temperature, density = standard_air(height, lapse)
        gas = pressure * volume / (GAS_CONSTANT * temperature) * 0.0040026
        expected.append((density * volume - 100.0 - gas) * GRAVITY / (100.0 + gas + 0.5 * density * volume))
    assert max(expected) > 1.5 * min(expected)
    np.testing.assert_allclose(speeds * 20.0, expected, rtol=0.02)
    assert (
        abs(simulator.state.pressures.numpy()).max() < 100.0
    )  # in balance with the air around it, of 31,000 Pa and more


@pytest.mark.parametrize("gamma", [1.0, 1.4])
def test_a_gas_that_is_carried_up_presses_more(gamma: float, device: str):
    """Gas at 3,000 m presses by what it was filled with at 1,000 m, cooled with the air or not. The balloon is too
    heavy to expand in a millisecond, and its amount of gas balances the air at 1,000 m."""
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


@pytest.mark.full
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


@pytest.mark.parametrize(("schedule", "gamma"), [("gather", 1.4), ("lanes", 1.4), ("auto", 1.0)])
def test_gas_meets_the_air_at_its_height(schedule: str, gamma: float, device: str):
    """Flows of gas use the air at the balloon's height. Pumped gas has its temperature, V_0 = (R T / p_0) (p_0 / p)^(1
    - 1 / gamma) a mole at the pressure p in full; litres are litres of it; a leak follows its density, rho C A root(2 p
    / rho); and a tube conserves p_1 V + p_2 V. At 3,000 m each would be off by 3 % and more with the air at height 0.
    Float32's volumes give the pressures to a ten-thousandth."""
    heights = [0.0, 3000.0]
    if schedule == "lanes" and device != "cpu":
        pytest.skip("lanes is for the CPU")
    vary = {f"balloon.{number}.position.1": heights for number in range(5)}
    simulator = Simulator(aloft(gamma), device, 2, vary, schedule=schedule)
    volume = signed_volume(quad_sphere(3, 1.0))
    before = simulator.state.gas_amounts.numpy().copy(), simulator.state.free_volumes.numpy().copy()
    for _ in range(20):
        simulator.step()
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
        gone = 1e-3 * np.sqrt(2.0 * pressures[world, 2] * density) / 0.0040026
        assert flows[world, 2] == pytest.approx(gone, rel=1e-3)
        assert more[4] > 1e-3
        if gamma == 1.0:
            np.testing.assert_allclose(free_volumes[world], amounts[world] * a_mole, rtol=1e-5)
        else:
            inside = 101325.0 * (free_volumes[world] / volume) ** gamma
            assert inside[3:].sum() == pytest.approx(2.0 * outside + 10_000.0, abs=2.0)
            np.testing.assert_allclose(inside, outside + pressures[world], rtol=3e-4)


def test_a_lapse_that_is_none_is_told():
    with pytest.raises(InputError, match=r"atmosphere.lapse: must be less than or equal to 0.1"):
        Atmosphere(lapse=6.5)


def test_gamma_that_changes_keeps_the_pressure_aloft(device: str):
    change = Change(time=0.001, set={"balloon.0.inflation.gamma": 1.4})
    balloon = gas_balloon(quad_sphere(3, 5.0), {"start_pressure": 500.0}, mass=1e7, position=(0.0, 3000.0, 0.0))
    scene = Scene(balloon=[balloon], atmosphere=Atmosphere(lapse=0.0065), change=[change], frames_per_second=1000.0)
    simulator = Simulator(scene, device)
    advanced(simulator, 3)
    assert simulator.state.pressures.numpy()[0, 0] == pytest.approx(500.0, abs=20.0)  # of 70,000, to 4 float32 volumes

"""Friction between balloons, against Coulomb's law."""

import numpy as np
import pytest
from touching import centers, ramp, run

from balloon_warp.scene import Change
from balloon_warp.schedules import SCHEDULES
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics


@pytest.fixture(params=SCHEDULES)
def way(request: pytest.FixtureRequest, device: str) -> str:
    """Return each schedule."""
    if request.param in ("lanes", "octets") and device != "cpu":
        pytest.skip(f"{request.param} is for the CPU")
    return request.param


@pytest.mark.parametrize("degrees", [20.0, 25.0])
def test_below_the_angle_of_friction_a_block_stays(degrees, way, device):
    """A block stays on a slope with the tangent below 0.5: it creeps by no more than the compliance of contacts."""
    simulator = run(ramp(degrees, friction=0.5), device, way, 30)
    before = centers(simulator)[1]
    for _ in range(60):
        simulator.step()
    assert np.linalg.norm(centers(simulator)[1] - before) < 1e-3


@pytest.mark.parametrize(("degrees", "friction"), [(35.0, 0.5), (20.0, 0.0), (30.0, 0.25)])
def test_above_it_a_block_slides_as_coulomb_says(degrees, friction, way, device):
    """A block slides at g (sin a - friction cos a), once it has come down on the plane."""
    simulator = run(ramp(degrees, friction), device, way, 20)
    before, speed = centers(simulator)[1], speed_of_block(simulator)
    for _ in range(30):
        simulator.step()
    angle = np.radians(degrees)
    expected = 9.81 * (np.sin(angle) - friction * np.cos(angle))
    assert (speed_of_block(simulator) - speed) / 0.5 == pytest.approx(expected, rel=0.03)
    moved = centers(simulator)[1] - before
    assert moved @ (0.0, np.cos(angle), np.sin(angle)) == pytest.approx(0.0, abs=0.005)  # along the plane


def speed_of_block(simulator: Simulator) -> float:
    velocities = simulator.state.velocities.numpy()[0, simulator.model.particle_offsets[1] :].astype(np.float64)
    return float(np.linalg.norm(velocities.mean(axis=0)))


def test_friction_may_differ_between_worlds_and_change(way, device):
    """The block slides from the start in the first world, and in the second once its friction is set to zero."""
    scene = ramp(20.0, friction=0.6, change=[Change(time=0.5, set={"touch.friction": 0.0})])
    still = Simulator(ramp(20.0, friction=0.6), device, 2, {"touch.friction": [0.1, 0.6]}, schedule=way)
    for _ in range(30):
        still.step()
    slid = [float(np.linalg.norm(centers(still, world)[1] - centers(still, 1)[1])) for world in (0, 1)]
    assert slid[0] > 0.1
    simulator = run(scene, device, way, 30)
    # on a GPU `scatter` adds in another order every time
    most = 1e-6 if way == "scatter" and device != "cpu" else 0.0
    np.testing.assert_allclose(centers(simulator)[1], centers(still, 1)[1], rtol=0.0, atol=most)
    for _ in range(15):
        simulator.step()
    assert speed_of_block(simulator) == pytest.approx(0.25 * 9.81 * np.sin(np.radians(20.0)), rel=0.05)

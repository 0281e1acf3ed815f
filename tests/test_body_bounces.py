"""Free rigid bodies that bounce, and their number of substeps."""

from typing import Any

import numpy as np
import pytest
from meshes import cube
from rigid import SPACE, after, body_energy, body_state, started

from balloon_warp.model.plan import plan_model
from balloon_warp.scene import Balloon, Body, Ground, Obstacle, Scene, Sphere
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

FALL = 0.9
"""[m]"""


def tops(simulator: Simulator, seconds: float, rest: float) -> list[float]:
    """Return the apex of a body after each bounce, above where it rests [m]: of each flight the frame nearest to its
    top, less than a hundredth of a second from there, and what is left to go there, v^2 / 2 g."""
    found, best, before = [], (np.inf, 0.0), 0.0
    for _ in range(round(seconds * 60.0)):
        simulator.step()
        height, speed = body_state(simulator, "positions")[0, 1] - rest, body_state(simulator, "velocities")[0, 1]
        if speed > before:  # it has bounced
            found.append(best[1])
            best = (np.inf, 0.0)
        best = min(best, (abs(speed), height + speed**2 / (2.0 * 9.81)))
        before = speed
    return found


def bouncing(device: str, floor: str, restitution: float, **fields: Any) -> Simulator:
    """Return a ball that falls on the ground, or a box on something."""
    ball = Body(radius=0.1, length=0.0, position=(0, FALL + 0.1, 0), restitution=restitution)
    brick = Body(size=(0.3, 0.2, 0.3), position=(0, FALL + 0.1, 0), restitution=restitution)
    table = Obstacle(size=(9, 1, 9), position=(0, -0.5, 0), restitution=restitution)
    setting: dict[str, Any] = {"gravity": 9.81, "frames_per_second": 60.0}
    if floor == "obstacle":
        return started(device, brick, obstacle=[table], **setting | fields)
    return started(device, ball, ground=Ground(restitution=restitution), **setting | fields)


@pytest.mark.full
@pytest.mark.parametrize("substeps", ["auto", 1, 13, 64])
@pytest.mark.parametrize("restitution", [0.3, 0.7, 1.0])
@pytest.mark.parametrize("floor", ["ground", "obstacle"])
def test_each_bounce_comes_back_to_the_square_of_the_restitution(floor, restitution, substeps, device):
    """Each apex is e^2 of the one before, within 2 %. The step conserves its own energy, off by g h v / 2 from the one
    measured, so apexes lower than a step's fall are left out."""
    found = tops(bouncing(device, floor, restitution, substeps=substeps), 2.5, 0.1)
    expected = FALL * restitution ** (2 * np.arange(len(found)))
    told = expected > (0.05 if substeps == 1 else 0.005)
    assert told.sum() >= 2
    np.testing.assert_allclose(np.array(found)[told], expected[told], rtol=0.02)


@pytest.mark.parametrize("way", ["scatter", "gather", "block"])
def test_bounces_go_on_for_ever_without_loss_or_gain(way, device):
    """Energy is conserved for ten seconds at restitution 1; a regression gained 79%."""
    simulator = bouncing(device, "ground", 1.0, substeps="auto", schedule=way)
    found = tops(simulator, 10.0, 0.1)
    assert len(found) == 12
    np.testing.assert_allclose(found, FALL, rtol=2e-3)


@pytest.mark.parametrize("substeps", ["auto", 13, 64])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_box_that_tumbles_gains_no_energy_by_bounces(friction, substeps, device):
    """Energy of a tumbling box does not grow by bounces, and is conserved without friction and with restitution 1; the
    measured one is off by m g h v / 2. Its first corner sets it spinning."""
    crate = Body(size=(0.2, 0.3, 0.15), position=(0, 1, 0), rotation=(20, 30, 10), restitution=1.0, friction=friction)
    simulator = started(
        device, crate, ground=Ground(restitution=1.0, friction=friction), gravity=9.81, frames_per_second=60.0,
        substeps=substeps,
    )  # fmt: skip
    start = body_energy(simulator)
    seen = 0.5 * 9.81 * simulator.model.step_seconds * 5.0
    for frame in range(300):
        simulator.step()
        assert body_energy(simulator) < start + seen
        if not friction:
            assert body_energy(simulator) > start - seen - 0.005 * start
        if frame == 30:
            assert np.linalg.norm(body_state(simulator, "momenta")) > 0.01


def test_a_sphere_that_falls_on_a_body_at_rest_gains_no_energy(device):
    ball = Sphere(position=(0, 1.3, 0), radius=0.1, mass=0.2, restitution=1.0)
    slab = Body(size=(1, 0.2, 1), position=(0, 0.1, 0), mass=50.0, restitution=1.0)
    simulator = started(
        device, slab, sphere=[ball], ground=Ground(restitution=0.0), gravity=9.81, substeps=4, frames_per_second=60.0
    )
    highest, start = -np.inf, 1.3
    for frame in range(240):
        simulator.step()
        if frame > 30:
            highest = max(highest, float(simulator.state.sphere_positions.numpy()[0, 0, 1]))
    assert 0.9 * start < highest < start * 1.001


@pytest.mark.parametrize("schedule", ["gather", "block"])
def test_two_that_touch_others_keep_momentum(schedule, device):
    """Momentum is conserved as four boxes meet in space: the impulses of each pair are opposite."""
    bodies = [
        Body(size=(0.3, 0.2, 0.3), position=(0.35 * i, 0.02 * i, 0), velocity=(1.0 - i, 0, 0), mass=1.0 + i)
        for i in range(4)
    ]
    simulator = started(device, *bodies, schedule=schedule, **SPACE)
    masses = np.array([1.0, 2.0, 3.0, 4.0])
    start = masses @ body_state(simulator, "velocities")
    before = body_state(simulator, "velocities")
    ended = masses @ body_state(after(simulator, 50), "velocities")
    np.testing.assert_allclose(ended, start, atol=500 * 4.0 * np.finfo(np.float32).eps)
    assert np.abs(body_state(simulator, "velocities") - before).max() > 0.3


def substeps_of(**fields: Any) -> int:
    """Return the substeps of a scene that by itself needs one."""
    slack = Balloon(mesh=cube(), position=(0, 9, 0), fixed=list(range(8)))
    return plan_model(Scene(balloon=[slack], **{"frames_per_second": 60.0} | fields)).substeps


def test_auto_counts_bodies_and_spheres():
    """Substeps follow from what may touch at all, by spin, and by speed over size, that of a fall to come as well."""
    crate = Body(position=(0, 1, 0))
    assert substeps_of() == 1
    assert substeps_of(sphere=[Sphere(position=(0, 1, 0))]) == 8
    assert substeps_of(body=[crate]) == 8
    assert substeps_of(body=[crate], frames_per_second=480.0) == 1
    assert substeps_of(body=[crate], substeps=3) == 3
    spinning = crate.model_copy(update={"angular_velocity": (60.0, 0.0, 0.0)})
    assert substeps_of(body=[spinning]) == 10  # a tenth of a radian each
    die = Body(size=(0.02, 0.02, 0.02), position=(0, 1, 0))
    reach = 0.01 * 3**0.5
    assert substeps_of(body=[die], ground=Ground()) == np.ceil((2 * 9.81 * 1.0) ** 0.5 / (0.25 * reach) / 60.0)
    thrown = die.model_copy(update={"velocity": (0.0, 0.0, 3.0)})
    assert substeps_of(body=[thrown], gravity=0.0) == np.ceil(3.0 / (0.25 * reach) / 60.0)
    shot = die.model_copy(update={"velocity": (0.0, 0.0, 900.0)})
    assert substeps_of(body=[shot], gravity=0.0) == 167  # no step is shorter than a tenth of a millisecond

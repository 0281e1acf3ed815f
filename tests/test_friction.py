"""Friction coefficients of balloons: the geometric mean of theirs and of what they touch."""

import numpy as np
import pytest
from conserved import motion, put
from meshes import cube
from touching import SLACK, centers, ramp

from balloon_warp.errors import InputError
from balloon_warp.scene import Balloon, Ground, Obstacle, Scene, load_scene
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

SURFACES = {
    "ground": {"ground": Ground(friction=0.5)},
    "obstacle": {"obstacle": [Obstacle(shape="plane", friction=0.5)]},
}


@pytest.mark.parametrize("surface", SURFACES)
def test_of_what_lands_each_loses_by_its_own(surface: str, schedule: str, device: str):
    """Friction of a balloon that lands at 1 m/s on a floor of 0.5 is the root of 0.04 with 0.08 of its own, 0.5
    without, and 0 with 0; it takes as much of 0.8 m/s."""
    balloons = [
        Balloon(mesh=cube(), position=(3.0 * number, 0.0, 0.0), damping=0.0, inflation=SLACK, friction=own)
        for number, own in enumerate((0.08, None, 0.0))
    ]
    still = {"gravity": 0.0, "atmosphere": {"density": 0.0}, "touch": False}
    scene = Scene(balloon=balloons, substeps=1, **still, **SURFACES[surface])
    simulator = Simulator(scene, device, schedule=schedule)
    put(simulator, velocities=np.tile([0.8, -1.0, 0.0], (24, 1)))
    simulator.step()
    velocities = motion(simulator)[1].reshape(3, 8, 3)[:, cube().points[:, 1] == 0.0]
    left = np.broadcast_to(np.array([0.6, 0.3, 0.8])[:, None], (3, 4))
    # rounding of 1 m/s, and of springs at rest: a GPU's fast roots leave them some 1e-7 too short
    np.testing.assert_allclose(velocities[:, :, 0], left, atol=1e-6 if device == "cpu" else 1e-5)


@pytest.mark.parametrize(
    ("plane", "block", "between"), [(0.8, 0.05, 0.2), (None, 0.1, 0.2), (0.0, None, 0.0), (None, None, 0.4)]
)
@pytest.mark.parametrize("way", ["scatter", "gather", "block"])
def test_between_balloons_it_is_the_mean_of_both(plane, block, between, way, device):
    """A block slides on another by Coulomb's law; `touch.friction`, 0.4, is the default coefficient."""
    scene = ramp(30.0, 0.4)
    owns = zip(scene.balloon, (plane, block), strict=True)
    scene = scene.model_copy(update={"balloon": [each.model_copy(update={"friction": own}) for each, own in owns]})
    simulator = Simulator(scene, device, schedule=way)
    speeds = []
    for frame in range(40):
        simulator.step()
        if frame in (19, 39):
            speeds.append(np.linalg.norm(motion(simulator)[1][simulator.model.particle_offsets[1] :].mean(axis=0)))
    angle = np.radians(30.0)
    expected = 9.81 * (np.sin(angle) - between * np.cos(angle))
    assert (speeds[1] - speeds[0]) * 3.0 == pytest.approx(expected, rel=0.05)
    assert centers(simulator)[1, 2] > 0.0  # down the plane


def test_it_may_differ_between_worlds_and_must_not_be_negative(device):
    scene = Scene(balloon=[Balloon(mesh=cube(), inflation=SLACK)], gravity=0.0, substeps=1, **SURFACES["ground"])
    simulator = Simulator(scene, device, 2, {"balloon.friction": [0.08, 0.5]})
    put(simulator, velocities=np.tile([0.8, -1.0, 0.0], (8, 1)))
    simulator.step()
    slowed = simulator.state.velocities.numpy()[:, cube().points[:, 1] == 0.0, 0].mean(axis=1)
    np.testing.assert_allclose(slowed, [0.6, 0.3], atol=0.01)  # and what damping takes
    with pytest.raises(InputError, match=r"balloon\.0\.friction: must be greater than or equal to 0 \(got -1\.0\)"):
        load_scene(scene, {"balloon.0.friction": -1.0})

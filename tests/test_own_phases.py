"""Phases that the package does not know go in by a line of the list: their rows are the scene's, and every schedule
runs them and carries what their items keep."""

import numpy as np
import pytest
from meshes import quad_sphere
from own_phases import START, list_after, slow, warm, weaken

from balloon_warp.errors import InputError
from balloon_warp.scene import Balloon, Inflation, Scene, Sphere
from balloon_warp.scene.overrides import override_scene
from balloon_warp.scene.schema.scene import Change
from balloon_warp.simulator import Simulator

BALL = Balloon(mesh=quad_sphere(3, 0.5), inflation=Inflation(k_normal=0.2))
FAR = Sphere(position=(0.0, 9.0, 0.0))
RINGED = Sphere(position=(0.0, 0.9, 0.0), radius=0.1)
SCENE = Scene(balloon=[BALL], sphere=[FAR, RINGED], gravity=0.0, substeps=12, frames=3, normals="cached")
SLOWED = {"sphere.1.law.slow.slow_radius": 0.7, "sphere.1.law.slow.slowing": 40.0}
WARMED = {"balloon.law.warm.weakening": 2e-3, "balloon.law.warm.warming_seconds": 0.05, "atmosphere.temperature": 330.0}


@pytest.fixture
def listed(monkeypatch: pytest.MonkeyPatch) -> None:
    list_after(monkeypatch, "push", slow)
    list_after(monkeypatch, "pull", warm, weaken)


def simulated(changes: dict, schedule: str, device: str, frames: int = 2, **more) -> Simulator:
    simulator = Simulator(override_scene(SCENE, list(changes.items())), device, schedule=schedule, **more)
    for _ in range(frames):
        simulator.step()
    return simulator


def test_a_sphere_slows_what_is_near(listed, schedule, device):
    """As by NumPy: in a step what is within 0.7 m of the second sphere, beside one without."""
    one_step = {"frames_per_second": 200.0, "substeps": 1} | SLOWED
    simulators = [simulated(one_step | {"sphere.1.law.slow.slowing": rate}, schedule, device, 0) for rate in (40.0, 0.0)]
    shape = (*simulators[0].state.points.shape, 3)
    velocities = np.random.default_rng(1).uniform(-1.0, 1.0, shape).astype(np.float32)
    near = np.linalg.norm(simulators[0].state.points.numpy() - (0.0, 0.9, 0.0), axis=2) < 0.7
    for each in simulators:
        each.state.velocities.assign(velocities)
        each.step()
    found, expected = (each.state.velocities.numpy() for each in simulators)
    assert 0 < near.sum() < near.size
    np.testing.assert_allclose(found, expected / np.where(near, 1.2, 1.0)[..., None], atol=1e-6)


def test_temperatures_follow_the_air_s(listed, schedule, device):
    """From substep to substep and frame to frame: each takes the same part of what is left. Worlds differ."""
    simulator = simulated(WARMED, schedule, device, 2, world_count=3, vary={"atmosphere.temperature": [330.0, 300.0, 280.0]})
    left = (0.05 / (0.05 + simulator.model.step_seconds)) ** (2 * SCENE.substeps)
    expected = np.array([330.0, 300.0, 280.0]) + np.array([-30.0, 0.0, 20.0]) * left
    found = simulator.state.kept["temperature"].numpy()
    np.testing.assert_allclose(found, np.broadcast_to(expected[:, None], found.shape), rtol=1e-5)

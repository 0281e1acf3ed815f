"""Controls that are saved with a simulator, and rotations of balloons by best fit."""

import numpy as np
import pytest
import warp as wp
from meshes import quad_sphere

from balloon_warp import Simulator
from balloon_warp.foil.make import foil_mesh
from balloon_warp.scene import Balloon, Inflation, Obstacle, Scene

BALL = Balloon(mesh=quad_sphere(3, 0.5), position=(0.0, 2.0, 0.0), inflation=Inflation(pressure=5.0))
PLATE = Obstacle(shape="box", size=(1.0, 0.1, 1.0), position=(0.0, 1.0, 0.0))
SCENE = Scene(balloon=[BALL], obstacle=[PLATE], substeps=24)


def controlled() -> Simulator:
    """Return three worlds, of which one was ended by its control."""
    simulator = Simulator(SCENE, "cpu", 3)
    simulator.controls["balloon.inflation.pressure"] = [1.0, 2.0, 3.0]
    simulator.controls.open("obstacle.0.velocity", -2.0, 2.0)
    simulator.controls["obstacle.0.velocity"] = np.array([[0, 1, 0], [0, 2, 0], [0, np.nan, 0]], dtype=np.float32)
    for _ in range(3):
        simulator.advance()
    return simulator


def followed(simulator: Simulator) -> list[np.ndarray]:
    """Return the state three frames later, with other values meanwhile."""
    simulator.advance()
    simulator.controls["balloon.inflation.pressure"] = [4.0, 5.0, 6.0]
    for _ in range(2):
        simulator.advance()
    places = simulator.observations["obstacle_positions"].numpy().copy()
    return [simulator.state.points.numpy().copy(), places, simulator.controls.faults.numpy().copy()]


@pytest.mark.full
@pytest.mark.parametrize("where", ["in itself", "in another", "in another with those controls", "from a file"])
def test_a_saved_simulator_goes_on_with_its_controls(where: str, tmp_path):
    first = controlled()
    saved = first.save()
    np.savez(tmp_path / "here.npz", **saved)
    expected = followed(first)
    other = controlled() if "those" in where else first if "itself" in where else Simulator(SCENE, "cpu", 3)
    other.restore(dict(np.load(tmp_path / "here.npz")) if "file" in where else saved)
    assert set(other.controls) == {"balloon.inflation.pressure", "obstacle.0.velocity"}
    assert other.controls.faults.numpy().tolist() == [0, 0, 2]
    for found, before in zip(followed(other), expected, strict=True):
        np.testing.assert_array_equal(found, before)


@pytest.mark.parametrize("flat", [False, True])
def test_turns_are_those_by_which_points_were_turned(flat: bool):
    """The best-fit rotations of a round and a flat balloon are the applied ones, unchanged by stretch and shift."""
    mesh = foil_mesh("o", height=0.3) if flat else quad_sphere(4, 0.5)
    scene = Scene(balloon=[Balloon(mesh=mesh, inflation=Inflation(pressure=5.0))])
    simulator = Simulator(scene, "cpu", 4)
    turns = simulator.observations["turns"]
    np.testing.assert_allclose(turns.numpy()[:, 0], [[0, 0, 0, 1]] * 4, atol=1e-5)
    draw = np.random.default_rng(0)
    quaternions = draw.normal(size=(4, 4))
    quaternions *= (np.sign(quaternions[:, 3]) / np.linalg.norm(quaternions, axis=1))[:, None]
    start = simulator.state.points.numpy()[0].astype(np.float64)
    turned = [rotation(quaternion) @ (1.3 * start).T for quaternion in quaternions]
    ways = draw.normal(size=(4, 1, 3))
    simulator.state.points.assign(wp.array(np.swapaxes(turned, 1, 2) + ways, dtype=wp.vec3, device="cpu"))
    simulator.observations.refresh()
    np.testing.assert_allclose(turns.numpy()[:, 0], quaternions, atol=2e-4)  # float32, of sums over all particles


def rotation(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of a quaternion x, y, z, w."""
    x, y, z, w = quaternion
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross

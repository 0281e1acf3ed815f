"""Controls: values written on the device, which the next frame uses, and that are saved."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from meshes import quad_sphere
from trimesh.transformations import quaternion_matrix

from balloon_warp import BlowUpError, InputError, Simulator, foil_mesh, load_scene
from balloon_warp.model.timeline import acting_laws
from balloon_warp.scene import Balloon, Ground, Inflation, Obstacle, Scene, Sphere, String

BALL = Balloon(mesh=quad_sphere(3, 0.5), inflation=Inflation(pressure=5.0))
ABOVE, BELOW = Sphere(position=(0.0, 0.8, 0.0), radius=0.4), String(anchor=(0.0, -1.0, 0.0), length=0.4)
SCENE = Scene(balloon=[BALL], sphere=[ABOVE], string=[BELOW], substeps=24)
BOUNDED = {
    "balloon.inflation.pressure": (0.0, 100.0),
    "balloon.damping": (0.0, 2.0),
    "balloon.drag_coefficient": (0.0, 1.0),
    "atmosphere.wind": (-9.0, 9.0),
    "string.0.anchor": (None, None),
    "gravity": (0.0, 10.0),
}
"""of `SCENE`: a keyframed value, a material's, a law's that did not act, a world's, a vector, and gravity"""
PRESSURE = "balloon.inflation.pressure"


def points(simulator: Simulator) -> np.ndarray:
    return simulator.state.points.numpy().copy()


def values_of(frame: int) -> dict[str, np.ndarray]:
    """Return the values of a frame, for each control in each of three worlds."""
    drawn = np.random.default_rng(frame).uniform(0.1, 0.9, (3, 6, 3)).astype(np.float32)
    vectors = ("atmosphere.wind", "string.0.anchor")
    return {path: drawn[:, n] if path in vectors else drawn[:, n, 0] for n, path in enumerate(BOUNDED)}


def test_a_control_is_what_set_sets_bit_for_bit(schedule: str, device: str):
    """Set values have the bits of planned changes, and of worlds alone (test_setting.py)."""
    controlled, told = (Simulator(SCENE, device, 3, schedule=schedule) for _ in range(2))
    for path, (low, high) in BOUNDED.items():
        controlled.controls.open(path, low, high)
    for frame in range(3):
        for path, values in values_of(frame).items():
            controlled.controls[path] = values
        told.set(values_of(frame))
        controlled.step_unread()
        told.step_unread()
    np.testing.assert_array_equal(points(controlled), points(told))
    assert np.ptp(points(controlled), axis=0).max() > 1e-4


@pytest.mark.full
def test_an_obstacle_that_is_steered_goes_as_one_that_moves_by_keyframes(schedule: str, device: str):
    ball = BALL.model_copy(update={"position": (0.0, 0.52, 0.0), "velocity": (0.0, -0.5, 0.0)})
    plate = Obstacle(size=(3.0, 0.2, 3.0), position=(0.0, -0.1, 0.0), rotation=(0.0, 0.0, 5.0), friction=0.6)
    velocity, seconds = np.array([1.0, 0.7, -0.4]), 12 / 60
    scene = Scene(balloon=[ball], obstacle=[plate], substeps=24)
    keyframes = [(0.0, (0.0, 0.0, 0.0)), (seconds, tuple(seconds * velocity))]
    moving = scene.model_copy(update={"obstacle": [plate.model_copy(update={"motion": keyframes})]})
    steered, told, alone = (Simulator(each, device, 2, schedule=schedule) for each in (scene, moving, scene))
    steered.controls.open("obstacle.0.velocity", -2.0, 2.0)
    steered.controls["obstacle.0.velocity"] = np.tile(velocity, (2, 1))
    for each in [steered, told, alone] * 12:
        each.step_unread()
    np.testing.assert_allclose(points(steered), points(told), atol=2e-5)
    assert np.abs(points(alone) - points(told))[..., 0].max() > 0.01, "it is taken along"


def test_an_array_begins_with_what_the_scene_has_and_stays(device: str):
    simulator = Simulator(SCENE, device, 2, {PRESSURE: [1.0, 2.0]})
    pressure = simulator.controls.open(PRESSURE, 0.0, 10.0)
    assert pressure.numpy().tolist() == [1.0, 2.0]
    simulator.set({PRESSURE: [3.0, 4.0]})
    assert pressure.numpy().tolist() == [3.0, 4.0]
    simulator.step()
    simulator.reset()
    assert simulator.controls[PRESSURE] is pressure
    assert pressure.numpy().tolist() == [1.0, 2.0]
    again = Simulator(SCENE, device, 2, {PRESSURE: [5.0, 2.0]})
    pressure.assign([5.0, 2.0])
    np.testing.assert_array_equal(simulator.step().points[0], again.step().points[0])


def test_what_is_beyond_the_bounds_is_clipped(device: str):
    clipped, within = (Simulator(SCENE, device) for _ in range(2))
    clipped.controls.open("gravity", 0.0, 5.0).fill_(1e9)
    within.controls.open("gravity", 0.0, 5.0).fill_(5.0)
    np.testing.assert_array_equal(clipped.step().points[0], within.step().points[0])


@pytest.mark.full
@pytest.mark.parametrize(("value", "beyond"), [(np.nan, "clip"), (np.inf, "clip"), (9.0, "end")])
def test_a_world_ends_and_the_others_go_on(value: float, beyond: str):
    simulator, sound = (Simulator(SCENE, "cpu", 3) for _ in range(2))
    simulator.controls.open("gravity", 0.0, 5.0, beyond).assign([1.0, value, 2.0])
    sound.controls.open("gravity", 0.0, 5.0).assign([1.0, 9.8, 2.0])
    simulator.advance()
    sound.advance()
    assert simulator.controls.faults.numpy().tolist() == [0, 1, 0]
    np.testing.assert_array_equal(points(simulator)[::2], points(sound)[::2])
    assert np.isfinite(points(simulator)).all()
    with pytest.raises(InputError, match=r"gravity: must be a finite number.*, in world 1 \(got "):
        simulator.step()


@pytest.mark.full
@pytest.mark.parametrize(
    ("path", "bounds", "sentence"),
    [
        ("balloon.mas", {}, r"balloon\.mas: cannot change"),
        ("balloon.position", {}, r"balloon\.position: cannot change"),
        ("balloon.stiffness", {}, r"balloon\.stiffness: must be the path of a number or a vector; known are "),
        ("balloon.mass", {}, r"balloon\.mass: the step depends on it; expected bounds, as in open"),
        ("gravity", {"low": 2.0, "high": 1.0}, r"gravity: low must be at most high \(got 2 and 1\)"),
        ("gravity", {"low": np.nan}, r"gravity: low must be a finite number \(got nan\)"),
        ("balloon.mass", {"low": -1.0, "high": 1.0}, r"balloon\.0\.mass: must be greater than 0 \(got -1\.0\)"),
        ("ground.friction", {}, r"friction: cannot be written on the device"),
        ("sphere.radius", {}, r"sphere\.radius: cannot be written on the device; `set` changes"),
        ("gravity", {"beyond": "stop"}, r'gravity: beyond must be "clip" or "end" \(got \'stop\'\)'),
        ("balloon.stiffness.structural", {"low": 1.0, "high": 1e7}, r"substeps: 24 are too few"),
    ],
)
def test_what_cannot_be_a_control_is_refused(path: str, bounds: dict, sentence: str):
    simulator = Simulator(SCENE.model_copy(update={"ground": Ground()}), "cpu", 2)
    with pytest.raises(InputError, match=sentence):
        simulator.controls.open(path, **bounds)
    assert len(simulator.controls) == 0


@pytest.mark.parametrize("values", [[1.0], [[1.0, 2.0]], "much", [1.0, "b"]])
def test_values_of_another_shape_are_refused(values: object):
    simulator = Simulator(SCENE, "cpu", 2)
    with pytest.raises(InputError, match=r"inflation\.pressure: expected a (value|number) for each world"):
        simulator.controls[PRESSURE] = values


def test_a_number_has_one_control():
    simulator = Simulator(SCENE, "cpu", 2)
    simulator.controls.open("balloon.damping", 0.0, 1.0)
    with pytest.raises(InputError, match=r"balloon\.0\.damping: is already written by the control balloon\.damping"):
        simulator.controls.open("balloon.0.damping", 0.0, 1.0)


def test_the_step_and_the_laws_are_those_of_the_bounds():
    scene = SCENE.model_copy(update={"substeps": "auto"})
    stiff, controlled = Simulator(load_scene(scene, {"balloon.mass": 0.01}), "cpu"), Simulator(scene, "cpu")
    controlled.controls.open("balloon.mass", 0.01, 1.0)
    assert controlled.model.substeps == stiff.model.substeps
    simulator = Simulator(SCENE, "cpu")
    before = acting_laws(simulator.model)
    simulator.controls.open("balloon.drag_coefficient", 0.0, 1.0)
    assert len(acting_laws(simulator.model)) == len(before) + 1
    assert acting_laws(replace(simulator.model, reach={})) == before


def test_arrays_of_others_are_taken():
    simulator = Simulator(SCENE, "cpu", 2)
    pressure = simulator.controls[PRESSURE]
    for given in (wp.array([1.0, 2.0], dtype=float, device="cpu"), np.array([1, 2]), [1.0, 2.0]):
        pressure.zero_()
        simulator.controls[PRESSURE] = given
        assert pressure.numpy().tolist() == [1.0, 2.0]
    simulator.controls[PRESSURE] = 4.0
    assert pressure.numpy().tolist() == [4.0, 4.0]


@pytest.mark.full
def test_a_blow_up_is_explained_by_the_frame_that_it_came_in():
    simulator = Simulator(SCENE, "cpu", 2)
    pressure = simulator.controls[PRESSURE]
    simulator.step()
    pressure.assign([5.0, 1e9])
    with pytest.raises(BlowUpError, match=r"in frame 2, world 1.* inflation pushed it"):
        simulator.step()


SAVED_BALL = BALL.model_copy(update={"position": (0.0, 2.0, 0.0)})
SAVED_SCENE = Scene(balloon=[SAVED_BALL], obstacle=[Obstacle(size=(1, 0.1, 1), position=(0, 1, 0))], substeps=24)
VELOCITY = "obstacle.0.velocity"


def controlled() -> Simulator:
    """Return three worlds, of which one was ended by its control."""
    simulator = Simulator(SAVED_SCENE, "cpu", 3)
    simulator.controls[PRESSURE] = [1.0, 2.0, 3.0]
    simulator.controls.open(VELOCITY, -2.0, 2.0)
    simulator.controls[VELOCITY] = np.array([[0, 1, 0], [0, 2, 0], [0, np.nan, 0]], dtype=np.float32)
    for _ in range(3):
        simulator.advance()
    return simulator


def followed(simulator: Simulator) -> list[np.ndarray]:
    """Return the state three frames later, with other values meanwhile."""
    simulator.advance()
    simulator.controls[PRESSURE] = [4.0, 5.0, 6.0]
    for _ in range(2):
        simulator.advance()
    places = simulator.observations["obstacle_positions"].numpy().copy()
    return [points(simulator), places, simulator.controls.faults.numpy().copy()]


@pytest.mark.full
@pytest.mark.parametrize("where", ["itself", "another", "another with those controls", "a file", "a copy", "pickled"])
def test_a_saved_simulator_goes_on_with_its_controls(where: str, tmp_path):
    first = controlled()
    saved = first.save()
    np.savez(tmp_path / "here.npz", **saved)
    copies = {"a copy": copy.deepcopy(first), "pickled": pickle.loads(pickle.dumps(first))}
    expected = followed(first)
    if where in copies:
        other = copies[where]
    else:
        other = controlled() if "those" in where else first if "itself" in where else Simulator(SAVED_SCENE, "cpu", 3)
        other.restore(dict(np.load(tmp_path / "here.npz")) if "file" in where else saved)
    assert set(other.controls) == {PRESSURE, VELOCITY}
    assert other.controls.faults.numpy().tolist() == [0, 0, 2]
    for found, before in zip(followed(other), expected, strict=True):
        np.testing.assert_array_equal(found, before)


@pytest.mark.parametrize("flat", [False, True])
def test_turns_are_those_by_which_points_were_turned(flat: bool):
    mesh = foil_mesh("o", height=0.3) if flat else quad_sphere(4, 0.5)
    scene = Scene(balloon=[Balloon(mesh=mesh, inflation=Inflation(pressure=5.0))])
    simulator = Simulator(scene, "cpu", 4)
    turns = simulator.observations["turns"]
    np.testing.assert_allclose(turns.numpy()[:, 0], [[0, 0, 0, 1]] * 4, atol=1e-5)
    draw = np.random.default_rng(0)
    quaternions = draw.normal(size=(4, 4))
    quaternions *= (np.sign(quaternions[:, 3]) / np.linalg.norm(quaternions, axis=1))[:, None]
    start = simulator.state.points.numpy()[0].astype(np.float64)
    turned = [1.3 * start @ quaternion_matrix(np.roll(quaternion, 1))[:3, :3].T for quaternion in quaternions]
    simulator.state.points.assign(np.array(turned) + draw.normal(size=(4, 1, 3)))
    simulator.observations.refresh()
    np.testing.assert_allclose(turns.numpy()[:, 0], quaternions, atol=2e-4)  # float32, of sums over all particles

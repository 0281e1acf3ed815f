"""Timeline of a simulation: changes, appearances and ends; values that are set, and controls on the device."""

import copy
import pickle
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import warp as wp
from feature_sets import feature_set
from meshes import cube, quad_sphere
from numpy.typing import NDArray
from pxr import Usd, UsdGeom
from scipy.spatial.transform import Rotation
from trajectories import stepped
from trimesh.transformations import quaternion_matrix

from balloon_warp import InputError, Material, Simulator, animate, foil_mesh, load_scene, run_batch
from balloon_warp.model import build_model
from balloon_warp.model.parameters import active_laws
from balloon_warp.scene import Balloon, Change, Ground, Inflation, Obstacle, Scene, Sphere, Stiffness, String

AT_REST = Balloon(
    mesh=cube(), stiffness=Stiffness(structural=0, shear=0, flexion=0), inflation=Inflation(pressure=0.0), damping=0.0
)
BUSY = Scene(
    balloon=[Balloon(mesh=quad_sphere(3, 0.5), inflation=Inflation(pressure=[(0.0, 5.0), (0.5, 9.0)]))],
    sphere=[Sphere(position=(0.0, 0.8, 0.0), radius=0.4), Sphere(position=(0.0, 5.0, 0.0), start=1.0)],
    string=[String(anchor=(0.0, -1.0, 0.0), length=0.4)],
    substeps=24,
    faces=False,
)


def after_frames(scene: Scene, frames: int, device: str, schedule: str = "auto", worlds: int = 1) -> Simulator:
    return stepped(Simulator(scene, device, worlds, schedule=schedule), frames)


def test_gravity_that_changes_or_is_set_bends_the_fall(device, schedule):
    """The velocity is -(g1 + g2) n h after n steps of symplectic Euler under g1, then n under g2, without springs."""
    changes = [Change(time=0.0, set={"gravity": 10.0}), Change(time=2 / 60, set={"gravity": 30.0})]
    scene = Scene(balloon=[AT_REST], gravity=1.0, substeps=3, change=changes)
    for worlds in (1, 3):
        velocities = after_frames(scene, 4, device, schedule, worlds).read_frame(worlds - 1).velocities[0]
        np.testing.assert_allclose(velocities[:, 1], -(10.0 + 30.0) * 2 / 60, rtol=1e-5)
    told = after_frames(scene.model_copy(update={"change": [], "gravity": 10.0}), 2, device, schedule, 2)
    told.set({"gravity": [30.0, 4.0]})
    falls = stepped(told, 2).state.velocities.numpy()[:, :, 1].T
    np.testing.assert_allclose(falls, np.tile([-(10.0 + 30.0) * 2 / 60, -(10.0 + 4.0) * 2 / 60], (8, 1)), rtol=1e-5)


def test_an_anchor_follows_keyframes(device: str):
    """Strings pull from there in test_reference.py."""
    frame = after_frames(feature_set("springs"), 3, device).read_frame()
    np.testing.assert_allclose(frame.string_anchors[1], (3.1, 2.3, 0.0), atol=1e-6)  # its last keyframe is at 0.04 s


@pytest.mark.full
def test_an_anchor_follows_an_obstacle(device: str):
    simulator = Simulator(feature_set("all"), device)
    begin, end = simulator.read_frame(), stepped(simulator, 3).read_frame()
    (before,), (after,) = begin.obstacle_poses, end.obstacle_poses
    turn = Rotation.from_quat(after[3:]) * Rotation.from_quat(before[3:]).inv()
    assert np.degrees(turn.magnitude()) == pytest.approx(90.0 * 3 / 60, rel=1e-5)
    told = after[:3] + turn.apply(begin.string_anchors[0] - before[:3])
    np.testing.assert_allclose(end.string_anchors[0], told, atol=1e-5)


@pytest.mark.parametrize(
    ("name", "values", "sentence"),
    [
        ("all", {"string.0.obstacle": 1}, "string.0.obstacle: must be below the number of obstacles, 1 (got 1)"),
        ("all", {"string.0.motion": [(0.0, (0, 0, 0))]}, "motion: an anchor follows an obstacle, a body or keyframes"),
        ("springs", {"string.1.motion": [(1.0, (0, 0, 0)), (1.0, (1, 0, 0))]}, "motion: keyframe times must increase"),
        ("springs", {"solver": "projective"}, "needs another solver"),
    ],
)
def test_an_anchor_that_cannot_follow_is_refused(name: str, values: dict[str, Any], sentence: str):
    with pytest.raises((InputError, ValueError), match=re.escape(sentence)):
        load_scene(feature_set(name), values)


ALL_AT_ONCE = {
    "gravity": 5.0,
    "balloon.helium": 1.0,
    "balloon.damping": 0.5,
    "balloon.mass": 0.15,
    "balloon.stiffness.structural": 12.0,
    "balloon.stiffness": {"shear": 5.0, "flexion": 3.0, "structural": 12.0},
    "balloon.inflation.k_normal": 0.4,
    "string.0.anchor": [0.1, -1.0, 0.2],
    "string.0.length": 0.3,
    "string.0.stiffness": 25.0,
    "sphere.0.mass": 2.0,
    "sphere.0.radius": 0.45,
}


def busy(**fields) -> Scene:
    """Return a balloon on a string that a sphere presses."""
    fields = {"normals": "cached"} | fields
    return Scene(
        balloon=[Balloon(mesh=quad_sphere(4, 0.5), inflation=Inflation(k_normal=[(0.0, 0.1), (0.5, 0.3)]))],
        sphere=[Sphere(position=(0.0, 0.8, 0.0), radius=0.4, penalty=30.0)],
        string=[String(anchor=(0.0, -1.0, 0.0), length=0.4)],
        substeps=24,
        **fields,
    )


def test_a_value_that_stays_changes_nothing(device, schedule):
    scenes = BUSY.model_copy(update={"change": [Change(time=0.02, set={"gravity": 9.81})]}), BUSY
    found, expected = (after_frames(scene, 4, device, schedule).state.points.numpy() for scene in scenes)
    np.testing.assert_array_equal(found, expected)


def test_other_substeps_go_on_from_the_same_state(device, schedule):
    change = Change(time=2 / 60, set={"substeps": 48})
    found = after_frames(BUSY.model_copy(update={"change": [change]}), 6, device, schedule)
    assert (found.model.substeps, found.frame_number) == (48, 6)
    difference = found.state.points.numpy() - after_frames(BUSY, 6, device, schedule).state.points.numpy()
    assert 1e-7 < np.abs(difference).max() < 2e-3


CHANGES = {
    **{path: ({path: value}, 1e-5) for path, value in ALL_AT_ONCE.items()},
    "forward Euler": ({"solver": "forward_euler"}, 1e-5),
    "fresh normals": ({"normals": "fresh"}, 1e-5),
    "correction": ({"correction": "provot", "correction_limit": 0.001}, 1e-4),  # its sweeps pass rounding on
    "impulse": ({"contact": "impulse"}, 1e-5),
}
"""Values and methods that take over after two frames, and the tolerance"""
OF_ALL = ("normals", "contact")
"""methods that every schedule has"""


@pytest.mark.full
@pytest.mark.parametrize("name", CHANGES)
def test_a_value_or_a_method_takes_over_in_every_schedule(name: str, device: str, schedule: str):
    change, tolerance = CHANGES[name]
    if name not in ALL_AT_ONCE and schedule != "gather" and not {*OF_ALL} & change.keys():
        if device == "cpu" and schedule != "octets":
            pytest.skip("auto is run for octets")
        schedule = "auto"  # which takes another where that one lacks the method
    expected, *others = scatters_places(name, device)
    found = places(after_frames(changing_to(change), 5, device, schedule))
    for thing in found:
        np.testing.assert_allclose(found[thing], expected[thing], rtol=0, atol=tolerance)
    for other in others:
        assert max(np.abs(expected[thing] - other[thing]).max() for thing in found) > 2 * tolerance


def changing_to(change: dict[str, Any]) -> Scene:
    """Return the scene in which something takes over."""
    return busy(change=[Change(time=2 / 60, set=change)])


def places(simulator: Simulator) -> dict[str, NDArray[np.float32]]:
    """Return the places of everything that moves."""
    return {name: getattr(simulator.state, name).numpy().copy() for name in ("points", "sphere_positions")}


@cache
def scatters_places(name: str, device: str) -> list[dict[str, NDArray[np.float32]]]:
    """Return the places after five frames of `scatter` with what takes over, without it and with a method throughout:
    once for all schedules."""
    change = CHANGES[name][0]
    scenes = [changing_to(change), busy(), *([] if name in ALL_AT_ONCE else [busy(**change)])]
    return [places(after_frames(scene, 5, device, "scatter")) for scene in scenes]


@pytest.mark.full
def test_a_sphere_waits_where_it_will_appear(device, schedule):
    """A sphere waits, and then falls freely: after n frames of m steps at h, by 1/2 g (n m h)^2 (1 + 1 / n m)."""
    late = Sphere(position=(0.0, 0.0, 0.0), radius=0.6, start=3 / 60)  # amid the cube, which it would push apart
    scene = Scene(balloon=[AT_REST], sphere=[late], substeps=4, gravity=0.0, faces=False)
    before = after_frames(scene, 3, device, schedule).read_frame()
    np.testing.assert_array_equal(before.points[0], np.float32(cube().points))
    after = after_frames(scene, 4, device, schedule).read_frame()
    assert np.linalg.norm(after.points[0][0]) == pytest.approx(0.6, abs=1e-5)
    falling = after_frames(scene.model_copy(update={"gravity": 9.81}), 5, device, schedule).read_frame()
    fallen = 0.5 * 9.81 * (2 / 60) ** 2 * (1 + 1 / 8)
    assert falling.sphere_positions[0, 1] == pytest.approx(-fallen, rel=1e-4)


@pytest.mark.full
def test_a_sphere_ends(device, schedule):
    scene = Scene(balloon=[AT_REST], sphere=[Sphere(position=(0.0, -0.2, 0.0), radius=0.1, end=1 / 60)], substeps=4)
    scenes = scene, scene.model_copy(update={"sphere": []})
    np.testing.assert_array_equal(*(after_frames(each, 12, device, schedule).read_frame().points[0] for each in scenes))


def test_a_string_is_tied_and_cut(device, schedule):
    """A string pulls up by k (d - L) from its start to its end: the impulse on its particle is that times the time."""
    tied = String(anchor=(0.0, 100.0, 0.0), particle=0, length=99.0, stiffness=1e-3, start=1 / 60, end=4 / 60)
    scene = Scene(balloon=[AT_REST], string=[tied], gravity=0.0, substeps=4)
    speeds = [after_frames(scene, frames, device, schedule).read_frame().velocities[0][0, 1] for frames in (1, 2, 4, 7)]
    acceleration = 1e-3 * 1.0 / (0.1 / 8)
    np.testing.assert_allclose(speeds, np.array([0, 1, 3, 3]) * acceleration / 60, rtol=1e-3)


def test_auto_substeps_are_enough_for_what_follows_and_too_few_are_refused():
    stiffer = Change(time=1.0, set={"balloon.stiffness.structural": 9000.0})
    scene = busy().model_copy(update={"substeps": "auto"})
    changing = scene.model_copy(update={"change": [stiffer]})
    assert build_model(changing, "cpu").substeps > build_model(scene, "cpu").substeps
    with pytest.raises(InputError, match=r"^substeps: 24 are too few"):
        build_model(busy(change=[stiffer]), "cpu")
    build_model(busy(change=[Change(time=1.0, set={**stiffer.set, "substeps": 100})]), "cpu")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            [Change(time=0, set={"balloon.position": [0, 0, 1]})],
            "change.0.set: balloon.position: cannot change; what can: substeps, solver",
        ),
        ([Change(time=0, set={"gravity": 1}), Change(time=1, set={"gravity": "up"})], "change.1.set: gravity: "),
        ([Change(time=0, set={"sphere.7.mass": 3.0})], "change.0.set: sphere.7.mass: cannot change"),
        (
            [Change(time=0, set={"balloon.inflation.k_normal": [(0.0, 1.0), (0.5, 2.0), (0.7, 3.0)]})],
            r"change: balloon.0.inflation.k_normal: must be a number, or keyframes at \[0.0, 0.5\] s \(got keyf",
        ),
    ],
)
def test_what_cannot_change_is_refused(changes, sentence):
    with pytest.raises(InputError, match=sentence):
        build_model(busy(change=changes), "cpu")


def test_what_changes_cannot_differ_between_worlds():
    scene = busy(change=[Change(time=0.1, set={"gravity": 1.0})])
    with pytest.raises(InputError, match=r"^gravity: changes during the simulation, and so cannot differ"):
        Simulator(scene, "cpu", 2, {"gravity": [1.0, 2.0]})


def test_a_model_is_left_as_it_was():
    change = Change(time=0.01, set={"gravity": 1.0, "balloon.mass": 0.2})
    model = build_model(BUSY.model_copy(update={"change": [change]}), "cpu")
    runs = [stepped(Simulator.of_model(model), 3) for _ in range(2)]
    np.testing.assert_array_equal(*(simulator.state.points.numpy() for simulator in runs))
    assert model.parameters["gravity"].numpy() == pytest.approx(9.81)


@pytest.mark.full
@pytest.mark.parametrize("batch", [False, True])
def test_the_stage_shows_what_is_there(tmp_path, batch):
    moved = {"string.0.anchor": [0.5, -1.0, 0.0], "string.0.length": 5.0}
    scene = busy(change=[Change(time=2 / 60, set=moved)], frames=4)
    late = scene.sphere[0].model_copy(update={"start": 2 / 60, "end": 3 / 60})
    scene = scene.model_copy(update={"sphere": [late]})
    if batch:
        run_batch(scene, tmp_path, 2, {"balloon.mass": [0.1, 0.2]}, export=[1], device="cpu")
    else:
        animate(scene, tmp_path / "worlds.usdc", device="cpu")
    stage = Usd.Stage.Open(str(tmp_path / "worlds.usdc"))
    paths = {prim.GetName(): prim for prim in stage.Traverse()}
    sphere = UsdGeom.Sphere(paths["Sphere_0"])
    assert sphere.GetRadiusAttr().Get() == late.radius
    seen = [sphere.ComputeVisibility(frame) == UsdGeom.Tokens.inherited for frame in range(5)]
    assert seen == [False, False, True, False, False]
    string = UsdGeom.BasisCurves(paths["String_0"])
    anchors = [tuple(string.GetPointsAttr().Get(frame)[0]) for frame in range(5)]
    assert anchors == [(0.0, -1.0, 0.0)] * 3 + [(0.5, -1.0, 0.0)] * 2
    curves = [np.array(string.GetPointsAttr().Get(frame)) for frame in range(5)]
    lengths = [np.linalg.norm(np.diff(curve, axis=0), axis=1).sum() for curve in curves]
    assert 1.5 * max(lengths[:3]) < min(lengths[3:])


def test_the_table_follows_a_change_of_method(device, tmp_path):
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(3))], frames=4, change=[Change(time=2 / 60, set={"substeps": 12})])
    run_batch(scene, tmp_path, 2, export=[1], device=device)
    with np.load(tmp_path / "table.npz") as table:
        heights = table["center_height"].reshape(5, 2)
    stage = Usd.Stage.Open(str(tmp_path / "worlds.usdc"))
    simulator = Simulator(scene, device, 2)
    for number in range(5):
        points = simulator.read_frame(1).points[0]
        ball = next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh) and "World_1" in str(prim.GetPath()))
        np.testing.assert_array_equal(UsdGeom.Mesh(ball).GetPointsAttr().Get(number), points)
        assert (np.diff(heights[: number + 1, 1]) < 0.0).all()
        simulator.step()


BALL = Balloon(mesh=quad_sphere(3, 0.5), inflation=Inflation(pressure=5.0))
SCENE = BUSY.model_copy(update={"balloon": [BALL]})
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
        ("balloon.stiffness", {}, r"balloon\.stiffness: must be the path of a number or a vector; known are "),
        ("balloon.mass", {}, r"balloon\.mass: the step depends on it; expected bounds, as in open"),
        ("gravity", {"low": 2.0, "high": 1.0}, r"gravity: low must be at most high \(got 2 and 1\)"),
        ("balloon.mass", {"low": -1.0, "high": 1.0}, r"balloon\.0\.mass: must be greater than 0 \(got -1\.0\)"),
        ("ground.friction", {}, r"friction: cannot be written on the device"),
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
    before = active_laws(simulator.model)
    simulator.controls.open("balloon.drag_coefficient", 0.0, 1.0)
    assert len(active_laws(simulator.model)) == len(before) + 1
    assert active_laws(replace(simulator.model, reach={})) == before


def test_arrays_of_others_are_taken():
    simulator = Simulator(SCENE, "cpu", 2)
    pressure = simulator.controls[PRESSURE]
    for given in (wp.array([1.0, 2.0], dtype=float, device="cpu"), np.array([1, 2]), [1.0, 2.0]):
        pressure.zero_()
        simulator.controls[PRESSURE] = given
        assert pressure.numpy().tolist() == [1.0, 2.0]
    simulator.controls[PRESSURE] = 4.0
    assert pressure.numpy().tolist() == [4.0, 4.0]


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
@pytest.mark.parametrize("where", ["itself", "another", "another with those controls", "pickled"])
def test_a_saved_simulator_goes_on_with_its_controls(where: str):
    first = controlled()
    saved, pickled = first.save(), pickle.loads(pickle.dumps(first))
    expected, another = followed(first), Simulator(SAVED_SCENE, "cpu", 3)
    other = {"itself": first, "another": another, "pickled": pickled}.get(where) or controlled()
    if where != "pickled":
        other.restore(saved)
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


SECONDS = 1 / 60
"""of a frame"""
SETS = {
    "numbers": {"gravity": 5.0, "balloon.mass": 0.15, "balloon.0.stiffness.shear": 12.0, "sphere.0.radius": 0.45},
    "vectors": {"string.0.anchor": (0.1, -1.0, 0.2), "atmosphere.wind": np.array([1.0, 0.0, 2.0])},
    "a table": {"balloon.stiffness": {"structural": 12.0, "shear": 5.0}},
    "keyframes": {"balloon.inflation.pressure": 30.0},
    "a keyframe": {"balloon.inflation.pressure.1.1": 30.0},
    "methods": {"contact": "impulse", "correction": "provot", "substeps": 30},
    "laws at rest": {"balloon.drag_coefficient": 0.5, "balloon.stiffness.torsion": 1e-3, "balloon.helium": 3.0},
}
"""on the way, of `BUSY`"""
MISTAKES = {
    "a name": ({"balloon.mas": 1.0}, r"balloon\.0\.mas: unknown field; did you mean mass\?"),
    "a bound": ({"balloon.mass": -1.0}, r"balloon\.0\.mass: must be greater than 0 \(got -1\.0\)"),
    "a world's bound": ({"balloon.mass": [1.0, -2.0]}, r"balloon\.0\.mass: must be .* \(got -2\.0\), in world 1"),
    "worlds": ({"balloon.mass": [1.0, 2.0, 3.0]}, r"balloon\.mass: expected a value for each of 2 worlds"),
    "the mesh": ({"balloon.mesh": "a.obj"}, r"balloon\.mesh: cannot change; what can: substeps, "),
    "no such thing": ({"sphere.5.mass": 2.0}, r"sphere\.5\.mass: no sphere 5, the scene has 2"),
    "not there yet": ({"sphere.1.radius": 0.2}, r"sphere\.1\.radius: sphere 1 does not exist in frame 1"),
    "auto": (
        {"balloon.inflation.pressure": "auto"},
        r"pressure: must be a number during the simulation \(got \"auto\"\)",
    ),
    "another kind": ({"balloon.inflation.moles": 1.0}, r'moles: needs kind = "gas" \(got kind = "pressure"\)'),
    "too long a step": ({"balloon.stiffness.structural": 1e6}, r"substeps: 24 are too few for these springs"),
    "no mapping": ([("balloon.mass", 2.0)], r"set: must be paths and values, as in "),
}


def test_a_step_hands_out_the_frame_of_a_world(device: str):
    simulator = Simulator(BUSY, device, vary={"balloon.mass": [0.1, 0.2]})  # as many worlds as values
    frame, second = simulator.step(), simulator.step(world=1)
    assert (frame.number, second.number) == (1, 2)
    np.testing.assert_array_equal(second.points[0], points(simulator)[1])
    assert np.abs(second.points[0] - frame.points[0]).max() > 1e-4
    with pytest.raises(InputError, match="no world 2"):
        simulator.step(world=2)
    with pytest.raises(InputError, match=r"^frames: expected at least 1 \(got 0\)$"):
        simulator.step(0)
    assert simulator.frame_number == 2
    assert simulator.step(3, world=1).number == 5


@pytest.mark.full
@pytest.mark.parametrize("name", SETS)
def test_what_is_set_does_what_the_same_change_of_a_scene_does(name: str, device: str):
    listed = {path: list(value) if isinstance(value, np.ndarray) else value for path, value in SETS[name].items()}
    planned = Simulator(BUSY.model_copy(update={"change": [Change(time=2 * SECONDS, set=listed)]}), device)
    simulator = stepped(Simulator(BUSY, device), 2)
    simulator.set(SETS[name])
    np.testing.assert_array_equal(points(stepped(simulator, 3)), points(stepped(planned, 5)))
    assert np.abs(points(simulator) - points(stepped(Simulator(BUSY, device), 5))).max() > 1e-6


def test_each_world_gets_its_own(device: str):
    masses, anchors = [0.1, 0.4], np.array([[0.0, -1.0, 0.0], [0.5, -1.0, 0.5]])
    simulator = stepped(Simulator(BUSY, device, 2), 1)
    simulator.set({"balloon.mass": masses, "string.0.anchor": anchors})
    stepped(simulator, 3)
    for world in (0, 1):
        alone = stepped(Simulator(BUSY, device), 1)
        alone.set({"balloon.mass": masses[world], "string.0.anchor": anchors[world]})
        np.testing.assert_array_equal(points(simulator)[world], points(stepped(alone, 3))[0])


@pytest.mark.full
def test_what_follows_from_a_value_follows():
    film = Balloon(mesh=quad_sphere(3), material=Material(preset="latex"), inflation=Inflation(pressure=10.0))
    simulator = Simulator(Scene(balloon=[film]), "cpu")
    mass, substeps = float(simulator.model.parameters["mass"].numpy()[0, 0]), simulator.model.substeps
    simulator.set({"balloon.material.thickness": 4.0 * film.material.value("thickness")})
    assert float(simulator.model.parameters["mass"].numpy()[0, 0]) == pytest.approx(4.0 * mass)
    assert simulator.model.substeps == substeps  # the frequency is that of the material
    pair = Scene(balloon=[Balloon(mesh=quad_sphere(3)), Balloon(mesh=quad_sphere(3), position=(2.5, 0, 0))])
    stiff = {"balloon.stiffness": {"structural": 80.0, "shear": 40.0, "flexion": 8.0}}
    plan = pair.model_copy(update={"change": [Change(time=0.5 / 60.0, set=stiff)]})
    before, told, planned = (Simulator(scene, "cpu") for scene in (pair, pair, plan))
    told.set(stiff)
    stepped(planned, 2)
    own = [each.model.parameters["touch_stiffnesses"].numpy()[0] for each in (before, told, planned)]
    np.testing.assert_allclose(own[1:], 4.0 * np.stack([own[0]] * 2), rtol=1e-6)
    substeps = [each.model.substeps for each in (before, told, planned)]
    assert substeps[1] == substeps[2] > 1.5 * substeps[0]  # of twice the frequency, rounded up


@pytest.mark.full
def test_what_the_scene_plans_happens_later_and_what_is_set_stays():
    changes = [Change(time=2 * SECONDS, set={"gravity": 3.0}), Change(time=3 * SECONDS, set={"correction": "provot"})]
    simulator = Simulator(BUSY.model_copy(update={"change": changes}), "cpu")
    simulator.set({"gravity": 5.0, "contact": "impulse", "substeps": 48})
    gravities = []
    for _ in range(4):
        simulator.step()
        gravities.append(float(simulator.model.parameters["gravity"].numpy()[0]))
    assert gravities == [5.0, 5.0, 3.0, 3.0]
    scene = simulator.model.scene
    assert (scene.contact, scene.correction, simulator.model.substeps) == ("impulse", "provot", 48)


@pytest.mark.parametrize("mistake", MISTAKES)
def test_what_cannot_be_set_is_one_sentence_and_nothing_changes(mistake: str):
    given, said = MISTAKES[mistake]
    simulator = stepped(Simulator(BUSY, "cpu", 2), 1)
    before = {name: array.numpy().copy() for name, array in simulator.model.parameters.items()}
    with pytest.raises(InputError, match=said):
        simulator.set({"gravity": 1.0, **given} if isinstance(given, dict) else given)
    for name, values in before.items():
        np.testing.assert_array_equal(simulator.model.parameters[name].numpy(), values, err_msg=name)


def test_reset_forgets_what_was_set(device: str):
    simulator = Simulator(BUSY, device)
    first = points(stepped(simulator, 2))
    simulator.set({"balloon.mass": 0.3, "balloon.drag_coefficient": 0.5})
    stepped(simulator, 1).reset()
    np.testing.assert_array_equal(points(stepped(simulator, 2)), first)


@pytest.mark.parametrize("how", [copy.copy, copy.deepcopy, lambda simulator: pickle.loads(pickle.dumps(simulator))])
def test_a_copy_goes_on_as_what_is_restored(how: Callable[[Simulator], Simulator]):
    worlds = "cpu", 2, {"balloon.mass": [0.1, 0.3]}
    simulator = stepped(Simulator(BUSY, *worlds), 1)
    simulator.set({"gravity": 3.0})
    other = how(stepped(simulator, 1))
    expected = points(stepped(simulator, 2))
    assert other.frame_number == 2
    np.testing.assert_array_equal(points(stepped(other, 2)), expected)
    other.set({"balloon.mass": 2.0})
    simulator.reset()
    np.testing.assert_array_equal(points(stepped(simulator, 1)), points(stepped(Simulator(BUSY, *worlds), 1)))


def test_a_simulator_of_a_model_is_not_pickled():
    with pytest.raises(InputError, match=r"cannot be pickled; .*save\(\)"):
        pickle.dumps(Simulator.of_model(Simulator(BUSY, "cpu").model))

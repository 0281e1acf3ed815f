"""Strings from balloons to free bodies: both ends are pulled alike, by where they are, and files show them there."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conserved import advanced, after_each
from meshes import cube
from numpy.typing import NDArray
from pxr import Usd, UsdGeom
from rigid import EPSILON, SPACE, body_state, whole
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from balloon_warp import InputError, Simulator, advise_step, animate, run_batch
from balloon_warp.model import plan_model
from balloon_warp.scene import Balloon, Body, Change, Ground, Inflation, Scene, String

BASKET = replace(cube(), points=cube().points * (0.2, 0.4, 0.1))
"""A box whose own origin is at a corner, as its anchors are told from there"""
MIDDLE, TOP = np.array([0.1, 0.2, 0.05]), (0.1, 0.4, 0.05)
NEVER = Change(time=1e4, set={"balloon.damping": 1.0})
"""Keeps the law of damping, and so the kernels, where a balloon has none"""


def tied(body: dict[str, Any], string: dict[str, Any], balloon: dict[str, Any] | None = None, **fields: Any) -> Scene:
    """Return a cube and a basket on a string."""
    bag = Balloon(mesh=cube(), inflation=Inflation(k_normal=0.0), **{"damping": 0.0} | (balloon or {}))
    told = {"frames_per_second": 100.0, "change": [NEVER], "touch": False, "ground": Ground(height=-50.0), **fields}
    return Scene(balloon=[bag], body=[Body(mesh=BASKET, **body)], string=[String(body=0, **string)], **told)


FLYING = tied(
    {"mass": 0.3, "position": (0.5, -1.0, 0.0), "velocity": (-0.2, -2.0, 0.3), "rotation": (20.0, 30.0, 10.0)},
    {"anchor": TOP, "particle": 0, "length": 0.5, "stiffness": 50.0},
    {"mass": 0.2, "velocity": (0.0, 1.0, 0.0), "angular_velocity": (1.0, 0.0, 2.0)},
    **SPACE,
)
"""A balloon that tears at a basket in free space"""


def pulls_of(simulator: Simulator) -> NDArray[np.float64]:
    """Return the tension of each string, as the frame has it [N]."""
    frame, scene = simulator.read_frame(), simulator.model.scene
    held = simulator.model.string_particle.numpy()
    spans = np.linalg.norm(np.concatenate(frame.points)[held].astype(float) - frame.string_anchors, axis=1)
    constants = np.array([string.stiffness for string in scene.string])
    return constants * np.maximum(spans - frame.string_lengths, 0.0)


def test_momentum_and_angular_momentum_of_both_stay(device: str):
    simulator = Simulator(FLYING, device)
    before = whole(simulator)
    pulls = after_each(simulator, 100, pulls_of)
    assert np.ptp(pulls) > 1.0  # it is taut and slack by turns
    assert np.linalg.norm(body_state(simulator, "momenta")) > 0.01
    for one, other in zip(before[:2], whole(simulator)[:2], strict=True):
        np.testing.assert_allclose(one, other, atol=40.0 * EPSILON * 0.6)


def test_anchors_are_told_in_the_axes_of_the_body_from_its_position(device: str):
    simulator, body = Simulator(FLYING, device), FLYING.body[0]
    anchor = body.position + Rotation.from_euler("xyz", body.rotation, degrees=True).apply(TOP)
    np.testing.assert_allclose(simulator.read_frame().string_anchors, [anchor], rtol=1e-6)
    frame = advanced(simulator, 30)
    turn = Rotation.from_quat(frame.body_poses[0, 3:])
    np.testing.assert_allclose(frame.string_anchors[0], frame.body_poses[0, :3] + turn.apply(TOP - MIDDLE), atol=1e-6)
    scene = FLYING.model_copy(update={"string": [String(body=0, anchor=TOP, particle=0)]})
    assert plan_model(scene).parameters["string_length"][0, 0] == pytest.approx(np.linalg.norm(anchor))


def test_a_balloon_that_carries_a_basket_floats_with_its_weight_in_the_string(device: str):
    """Helium lifts both weights."""
    weight = 0.05 * 9.81
    scene = tied(
        {"mass": 0.05, "position": (0.4, -1.4, 0.45)}, {"anchor": TOP, "particle": 0, "length": 0.8},
        {"mass": 0.1, "helium": 9.81 + weight / 0.1, "damping": 1.0},
    )  # fmt: skip
    simulator = Simulator(scene, device)
    assert np.abs(pulls_of(simulator) / weight - 1.0).max() > 0.1
    frame = advanced(simulator, 3000)
    np.testing.assert_allclose(pulls_of(simulator), weight, rtol=1e-3)
    assert abs(frame.velocities[0][:, 1].mean()) < 1e-3


def test_a_basket_on_a_balloon_that_is_held_swings_as_a_double_pendulum(device: str):
    """The slow way of a string and of what swings about its end: from it, T is known."""
    length, reach, inertia = 0.6, 0.2, (0.2**2 + 0.4**2) / 12.0
    masses = np.array([[length**2, length * reach], [length * reach, reach**2 + inertia]])
    squares, ways = eigh(9.81 * np.diag([length, reach]), masses)
    string, turn = 0.03 * ways[:, 0] / ways[0, 0]
    anchor = length * np.array([np.sin(string), -np.cos(string), 0.0])
    place = anchor - Rotation.from_euler("z", turn).apply(TOP)
    scene = tied(
        {"mass": 1.0, "position": tuple(place), "rotation": (0.0, 0.0, float(np.degrees(turn)))},
        {"anchor": TOP, "particle": 0, "length": length - 9.81 / 5e3, "stiffness": 5e3}, {"fixed": list(range(8))},
    )  # fmt: skip
    simulator, period = Simulator(scene, device), 2.0 * np.pi / np.sqrt(squares[0])
    swings = np.array(after_each(simulator, int(250 * period), lambda each: body_state(each, "positions")[0, 0]))
    past = np.flatnonzero(swings[:-1] * swings[1:] < 0.0)
    crossings = 0.01 * (past + 1.0 + swings[past] / (swings[past] - swings[past + 1]))
    np.testing.assert_allclose(np.diff(crossings), 0.5 * period, rtol=1e-3)
    assert len(crossings) == 5


@pytest.mark.parametrize("newtons", [3.0, 100.0])
def test_a_box_that_a_string_presses_to_the_ground_rests(newtons: float, device: str):
    """The box comes faster in each step than by two of gravity, and does not rebound: the string makes its speed."""
    scene = tied(
        {"mass": 0.1, "position": (0.1, 0.0, -0.05)}, {"anchor": MIDDLE, "particle": 2, "length": 0.5},
        {"fixed": list(range(8)), "position": (0.0, -2.0, 0.0)}, ground=Ground(),
    )  # fmt: skip
    (string,) = scene.string
    stiff = string.model_copy(update={"stiffness": newtons / (np.hypot(1.2, 0.2) - 0.5)})
    simulator = Simulator(scene.model_copy(update={"string": [stiff]}), device)
    np.testing.assert_allclose(pulls_of(simulator), newtons, rtol=1e-5)
    places = np.array(after_each(simulator, 60, lambda each: body_state(each, "positions")[0]))
    np.testing.assert_allclose(places, [np.add((0.1, 0.0, -0.05), MIDDLE)] * 60, atol=1e-6)
    assert np.abs(body_state(simulator, "velocities")).max() < 1e-5


@pytest.mark.parametrize("anchor", [pytest.param(tuple(MIDDLE), id="center"), pytest.param(TOP, id="aside")])
def test_a_light_body_is_part_of_the_stable_step(anchor: tuple[float, ...], device: str):
    """Two strings hold it in the middle of a balloon. The fewest substeps let it ring, and throw it nowhere."""
    mass, stiffness = 1e-4, 20.0
    string = {"anchor": anchor, "particle": 0, "length": 0.5, "stiffness": stiffness}
    scene = tied(
        {"mass": mass, "position": tuple(0.5 - np.array(anchor))}, string, {"fixed": list(range(8))}, gravity=0.0
    )
    scene = scene.model_copy(update={"string": [*scene.string, String(body=0, **string | {"particle": 7})]})
    with pytest.raises(InputError, match=r"^substeps: 1 are too few .* at least \d+ are needed") as refused:
        Simulator(scene.model_copy(update={"substeps": 1}), device)
    fewest = int(str(refused.value).partition("at least ")[2].split()[0])
    gain = (1.0 + (anchor[1] - 0.2) ** 2 / ((0.1**2 + 0.4**2) / 12.0)) / mass  # by turning about x, the most easily
    assert fewest == int(np.ceil(0.01 * np.sqrt(2.0 * 2.0 * stiffness * gain) / 2.0))
    assert advise_step(scene).limiting_body == 0
    kicked = [scene.body[0].model_copy(update={"velocity": (0.3, 0.1, 0.2), "angular_velocity": (0.5, 0.0, -0.5)})]
    simulator = Simulator(scene.model_copy(update={"substeps": fewest, "body": kicked}), device)
    speeds = after_each(simulator, 200, lambda each: np.linalg.norm(body_state(each, "velocities")))
    assert np.ptp(speeds) > 0.1
    assert max(speeds) < 1.0


def test_stages_draw_strings_to_where_bodies_have_come(device: str, tmp_path: Path):
    scene = FLYING.model_copy(update={"frames": 10})
    animate(scene, tmp_path / "one.usdc", device=device)
    run_batch(scene, tmp_path / "worlds", 2, {"body.0.mass": [0.3, 0.6]}, export=[0, 1], device=device)
    simulators = [Simulator(scene, device, 2, {"body.0.mass": [0.3, 0.6]})]
    advanced(simulators[0], 9)
    anchors = [simulators[0].read_frame(world).string_anchors[0] for world in (0, 1)]
    for path, expected in (("one.usdc", anchors[:1]), ("worlds/worlds.usdc", anchors)):
        stage = Usd.Stage.Open(str(tmp_path / path))
        curves = [UsdGeom.BasisCurves(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.BasisCurves)]
        curves = [curve for curve in curves if "String_0" in str(curve.GetPath())]
        assert len(curves) == len(expected)
        for curve, anchor in zip(curves, expected, strict=True):
            np.testing.assert_allclose(curve.GetPointsAttr().Get(9)[0], anchor, atol=1e-5)

"""Squirrel on its string: upright by default, upside down as in the paper's figures."""

import numpy as np
import pytest
from played import played, shape_at

from balloon_warp import Simulator, load_scene
from balloon_warp.mesh.geometry import signed_volume


def turned_by(rest: np.ndarray, points: np.ndarray, up: tuple[float, float, float]) -> float:
    """Return the angle [degrees] by which the best-fitting rotation (Kabsch 1976) turns the up axis."""
    left, _, right = np.linalg.svd((rest - rest.mean(axis=0)).T @ (points - points.mean(axis=0)))
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = right.T @ mirror @ left.T
    return float(np.degrees(np.arccos(np.clip(np.dot(rotation @ up, up), -1.0, 1.0))))


def test_squirrel_tether_floats_upright_and_still_above_its_anchor():
    """The string is at its length at the start, and straight at the end, stretched by the lift; after five seconds
    nothing moves by more than some millimeters a second."""
    model, frames = played("squirrel_tether")
    string, balloon, end = model.scene.string[0], model.scene.balloon[0], frames[-1]
    points = end.points[0].astype(np.float64)
    assert turned_by(model.shapes[0].mesh.points, points, model.scene.up) < 5.0
    np.testing.assert_allclose(points.mean(axis=0)[[0, 2]], 0.0, atol=0.01)
    assert np.linalg.norm(end.velocities[0], axis=1).max() < 0.005
    length = float(model.parameters["string_length"].numpy()[0, 0])
    held = model.string_particle.numpy()[0]
    reach = [float(np.linalg.norm(frame.points[0][held] - string.anchor)) for frame in (frames[0], end)]
    assert reach[0] == pytest.approx(length, rel=1e-6)
    lift = balloon.mass * (balloon.helium - model.scene.gravity)
    assert reach[1] - length == pytest.approx(lift / string.stiffness, rel=0.01)
    rest = model.shapes[0].mesh
    assert signed_volume(shape_at(model, end)) > 1.5 * signed_volume(rest)


PAPERS_TETHER = (
    ("balloon.inflation.k_normal", ((0.0, 2.0), (1.0, 8.0))),
    ("balloon.stiffness.thin", "alike"),
    ("string.anchor", (-0.3, 0.6, 0.0)),
    ("string.particle", "highest"),
    ("string.length", 1.0),
)
"""the paper's inflation, and the string at the very end of the tail"""


def test_squirrel_tether_turns_from_upright_to_upside_down():
    """It turns over in the frames of figures 19 to 21, and hangs so to the end, above a taut string."""
    model, frames = played("squirrel_tether", PAPERS_TETHER)
    places = [frames[number].points[0].astype(np.float64) for number in (0, 80, 300, -1)]
    turned = [turned_by(model.shapes[0].mesh.points, each, model.scene.up) for each in places]
    assert turned[0] < 1.0
    assert 45.0 < turned[1] < 100.0
    assert min(turned[2:]) > 120.0
    string, points = model.scene.string[0], places[-1]
    held = points[model.string_particle.numpy()[0]]
    assert string.length is not None
    assert np.linalg.norm(held - string.anchor) > string.length
    assert held[1] < points[:, 1].min() + 0.1
    assert points[:, 1].mean() > held[1] + 0.5


def test_a_taut_string_pulls_alike_in_eight_worlds_and_in_one():
    """Strings pull alike in `lanes`, which checks eight worlds at once, and in `octets`."""
    scene = load_scene("squirrel_tether", [("string.0.length", 0.01)])
    alone, one_of_two = (Simulator(scene, "cpu", count, schedule=name) for count, name in ((1, "octets"), (2, "lanes")))
    held = int(alone.model.string_particle.numpy()[0])
    start = alone.state.points.numpy()[0, held].copy()
    for simulator in (alone, one_of_two):
        simulator.advance()
    moved = alone.state.points.numpy()[0, held] - start
    assert np.linalg.norm(moved) > 1e-3
    np.testing.assert_allclose(one_of_two.state.points.numpy()[1, held] - start, moved, atol=1e-5)

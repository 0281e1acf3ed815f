"""Particles that leave obstacles in a launch of their own, which lists them first: on a GPU those of many worlds."""

import numpy as np
import pytest
import warp as wp
from meshes import quad_sphere
from trajectories import after_frames, arrays

from balloon_warp.kernels.schedules.launched import acts_on_few, is_asked_ahead
from balloon_warp.model import build_model
from balloon_warp.scene import Balloon, Inflation, Obstacle, Scene, load_scene
from balloon_warp.schedules.choose import fastest_schedule

FRAMES = 10
LID = 1.002  # height of the plane above the ball, which swells to it [m]


BALL = Balloon(mesh=quad_sphere(10, 0.5), position=(0.0, 0.501, 0.0), inflation=Inflation(k_normal=2.0))
"""of more than 512 particles, part of a list of its own"""
FLOOR = Obstacle(size=(3.0, 1.0, 3.0), position=(0.0, -0.5, 0.0))
CEILING = Obstacle(shape="plane", position=(0.0, LID, 0.0), rotation=(0.0, 0.0, 180.0))


@pytest.mark.full
@pytest.mark.parametrize(("changed", "is_told"), [({}, True), ({"correction": "provot"}, False)], ids=["told", "asked"])
def test_a_list_of_those_that_leave_obstacles_changes_nothing(changed, is_told, device, monkeypatch):
    """Whoever moves a particle notes it, or where others move it after that, the list asks for itself."""
    scene = Scene(balloon=[BALL], obstacle=[FLOOR, CEILING], **changed)
    expected = arrays(after_frames(scene, "gather", device, FRAMES, worlds=3))
    monkeypatch.setattr("balloon_warp.schedules.gather.has_many", lambda model: True)
    simulator = after_frames(scene, "gather", device, FRAMES, worlds=3)
    step = simulator.schedule.launches.step
    (piece,) = (piece for piece in step.pieces if acts_on_few(step, piece))
    assert is_asked_ahead(step, piece) == is_told
    found = arrays(simulator)
    heights = found["points"][0, :, 1]
    assert np.isclose(heights, 0.0, atol=1e-6).any()
    assert np.isclose(heights, LID, atol=1e-6).any()
    np.testing.assert_equal(found, expected)


@pytest.mark.parametrize(("name", "taken"), [("knot", "gather"), ("balloon_bunch", "block")])
def test_auto_takes_what_is_faster_for_many_worlds_that_touch(name: str, taken: str, gpu: wp.Device):
    """The automatic schedule of a crowded batch is the faster one by benchmarks/RESULTS.md."""
    assert fastest_schedule(build_model(load_scene(name), gpu), 1024) == taken

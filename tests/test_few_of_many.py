"""Particles that leave obstacles in a launch of their own, which lists them first: on a GPU those of many worlds."""

import numpy as np
import pytest
from meshes import quad_sphere
from trajectories import after_frames, arrays

from balloon_warp.kernels.schedules.launched.few import acts_on_few, is_asked_ahead
from balloon_warp.scene import Balloon, Inflation, Obstacle, Scene

FRAMES = 10
LID = 1.002  # height of the plane above the ball, which swells to it [m]


def between_planes(**changed) -> Scene:
    """Return a ball of more than 512 particles, part of a list of its own, that lies between a box and a plane."""
    ball = Balloon(mesh=quad_sphere(10, 0.5), position=(0.0, 0.501, 0.0), inflation=Inflation(k_normal=2.0))
    box = Obstacle(size=(3.0, 1.0, 3.0), position=(0.0, -0.5, 0.0))
    lid = Obstacle(shape="plane", position=(0.0, LID, 0.0), rotation=(0.0, 0.0, 180.0))
    return Scene(balloon=[ball], obstacle=[box, lid], **changed)


@pytest.mark.full
@pytest.mark.parametrize(("changed", "is_told"), [({}, True), ({"correction": "provot"}, False)], ids=["told", "asked"])
def test_a_list_of_those_that_leave_obstacles_changes_nothing(changed, is_told, device, monkeypatch):
    """Whoever moves a particle notes it, or where others move it after that, the list asks for itself."""
    scene = between_planes(**changed)
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
    for name in expected:
        np.testing.assert_array_equal(found[name], expected[name], err_msg=name)

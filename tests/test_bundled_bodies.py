"""Bundled scene with a free body: the pillow lifts the turtle, and neither is in the other."""

import numpy as np
import pytest
from played import played
from scipy.spatial.transform import Rotation

from balloon_warp.mesh.mesh_distance import MeshDistance

pytestmark = pytest.mark.physics

FULL = 150
"""frame in which the pillow has its pressure"""


@pytest.mark.full
def test_turtle_pillow_lifts_the_turtle_level():
    """The turtle rests on the ground through the flat pillow, and then a tenth of a meter higher. It tips by less than
    ten degrees, and no particle penetrates it by more than a hundredth of its height."""
    model, frames = played("turtle_pillow")
    body = model.bodies[0]
    assert body.solid.mesh
    distance = MeshDistance(body.solid.mesh.points, body.solid.triangles, thickness=0.0)
    height = float(np.ptp(body.solid.mesh.points[:, 1]))
    for frame in frames[::10]:
        turn = Rotation.from_quat(frame.body_poses[0, 3:])
        seen = turn.inv().apply(frame.points[0].astype(np.float64) - frame.body_poses[0, :3])
        assert distance(seen).min() > -0.01 * height
        assert turn.apply((0.0, 1.0, 0.0))[1] > np.cos(np.radians(10.0))
    heights = np.array([frame.body_poses[0, 1] for frame in frames])
    lowest = heights[: FULL // 3].min()
    assert lowest < 0.4 * height + 0.01
    assert heights[-60:].min() > lowest + 0.07
    assert np.ptp(heights[-30:]) < 0.02

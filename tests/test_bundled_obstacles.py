"""Bundled scenes with obstacles: no tunneling, and what they show."""

import numpy as np
import pytest
from played import played, shape_at
from scipy.spatial.transform import Rotation

from balloon_warp import Frame
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.mesh.mesh_distance import MeshDistance
from balloon_warp.model import Model

pytestmark = pytest.mark.physics

ROUNDING = 2e-5
"""float32's, of points on a surface a meter from the origin [m]"""


def seen_from(frame: Frame, number: int, balloon: int) -> np.ndarray:
    """Return a balloon's points in the frame of an obstacle."""
    pose = frame.obstacle_poses[number]
    return Rotation.from_quat(pose[3:]).inv().apply(frame.points[balloon].astype(np.float64) - pose[:3])


def box_distances(model: Model, frame: Frame, number: int) -> np.ndarray:
    beyond = np.abs(seen_from(frame, number, 0)) - model.obstacles[number].size
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


@pytest.mark.full
def test_no_balloon_goes_through_the_table():
    model, frames = played("table")
    table = model.obstacles[0]
    assert table.mesh
    distance = MeshDistance(table.mesh.points, table.triangles, thickness=0.0)
    for frame in frames[::5]:
        for balloon in range(4):
            assert distance(seen_from(frame, 0, balloon)).min() > -ROUNDING


@pytest.mark.full
def test_balloons_roll_off_the_table():
    """Balloons roll without slipping, within a third; and those nearer to the edge fall first."""
    model, frames = played("table")
    heights = np.array([[points[:, 1].mean() for points in frame.points] for frame in frames])
    off = (heights < 0.5).argmax(axis=0)  # well below the top
    order = np.argsort([-shape.mesh.points[:, 0].mean() for shape in model.shapes])
    assert (off > 0).all()
    assert (np.diff(off[order]) > 0).all()
    for balloon in range(4):
        begin, end = (frames[number].points[balloon].astype(np.float64) for number in (90, 120))
        way = np.linalg.norm(end.mean(axis=0) - begin.mean(axis=0))
        turn = Rotation.align_vectors(end - end.mean(axis=0), begin - begin.mean(axis=0))[0].as_rotvec()
        radius = np.linalg.norm(end - end.mean(axis=0), axis=1).mean()
        assert -turn[2] * radius == pytest.approx(way, rel=1 / 3)


@pytest.mark.full
def test_the_press_squeezes_and_lets_go():
    """The squirrel is pressed as low as the plates let it be, and grows deeper; then it rises again."""
    model, frames = played("press")
    for frame in frames:
        assert min(box_distances(model, frame, number).min() for number in (0, 1)) > -ROUNDING
    before, squeezed, after = (frames[number] for number in (12, 80, 209))
    tops = [frame.points[0][:, 1].max() for frame in (before, squeezed, after)]
    assert tops[1] == pytest.approx(1.12 - 0.56 - 0.04, abs=1e-4)
    assert min(tops[0], tops[2]) > 1.5 * tops[1]
    depths = [np.ptp(frame.points[0][:, 2]) for frame in (before, squeezed)]
    assert depths[1] > 1.2 * depths[0]
    volumes = [signed_volume(shape_at(model, frame)) for frame in (squeezed, after)]
    assert volumes[1] > 1.1 * volumes[0]

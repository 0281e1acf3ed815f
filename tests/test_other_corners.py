"""Neighboring corners of each corner of a face, as tables of schedules list them."""

import numpy as np

from balloon_warp import PolygonMesh
from balloon_warp.model import build_model
from balloon_warp.scene import Scene
from balloon_warp.schedules.tables import other_corners

FACES = ((0, 1, 2), (2, 1, 3, 4), (4, 3, 5, 6, 0))


def test_each_corner_has_the_rest_of_its_face_in_turn():
    points = np.random.default_rng(0).normal(size=(7, 3))
    mesh = PolygonMesh(points, np.array([3, 4, 5]), np.concatenate(FACES))
    corners = other_corners(build_model(Scene(balloon=[{"mesh": mesh, "holes": "keep"}]), "cpu"))
    listed = [face[turn:] + face[:turn] for face in FACES for turn in range(len(face))]
    expected = sorted(listed, key=lambda fan: fan[0])  # stable: those of a particle in the order of the faces
    assert corners.particles.tolist() == [fan[0] for fan in expected]
    assert corners.sizes.tolist() == [len(fan) - 1 for fan in expected]
    assert np.diff(corners.begins).tolist() == corners.sizes.tolist()
    assert corners.others.tolist() == [corner for fan in expected for corner in fan[1:]]

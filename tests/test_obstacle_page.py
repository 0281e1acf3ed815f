"""Obstacles in the page, without a browser."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from meshes import cube, quad_sphere

from balloon_warp.model import build_model
from balloon_warp.model.obstacles import ObstacleShape
from balloon_warp.scene import Balloon, Obstacle, Scene
from balloon_warp.viewer.session import Session

UPS = {"Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


def shapes(up_axis: str) -> list[ObstacleShape]:
    obstacles = [
        Obstacle(size=(1.0, 2.0, 3.0), position=(0.0, -9.0, 0.0)),
        Obstacle(radius=0.2, length=0.6, position=(3.0, 0.0, 0.0)),
        Obstacle(shape="plane", position=(0.0, -2.0, -2.0)),
        Obstacle(mesh=cube(), position=(-3.0, 0.0, 0.0)),
    ]
    scene = Scene(up_axis=up_axis, balloon=[Balloon(mesh=quad_sphere(3))], obstacle=obstacles)
    return build_model(scene, "cpu").obstacles


@pytest.mark.parametrize("up_axis", UPS)
def test_what_is_drawn_has_their_shapes(up_axis: str):
    """Drawn surfaces have the volume and extent of the shapes, with faces that wind outward."""
    pytest.importorskip("viser")
    from balloon_warp.viewer.obstacles import surface_of

    up = np.array(UPS[up_axis])
    box, capsule, plane, mesh = shapes(up_axis)
    below = np.array([0.5, 4.0, 7.0])
    drawn = [trimesh.Trimesh(*surface_of(shape, UPS[up_axis], below, 10.0)) for shape in (box, capsule, plane, mesh)]
    volumes = [drawn[solid].volume for solid in (0, 1, 3)]
    np.testing.assert_allclose(volumes, [6.0, np.pi * 0.2**2 * (0.6 + 4 / 3 * 0.2), 1.0], rtol=0.01)
    np.testing.assert_allclose(np.ptp(drawn[0].bounds, axis=0), [1.0, 2.0, 3.0])
    np.testing.assert_allclose(drawn[1].bounds, np.outer([-1.0, 1.0], 0.2 + 0.3 * up), atol=1e-9)
    np.testing.assert_allclose(drawn[2].face_normals, [up, up], atol=1e-9)
    np.testing.assert_allclose(drawn[2].bounds.mean(axis=0), below - (below @ up) * up, atol=1e-9)


def test_the_page_moves_what_moves(tmp_path: Path):
    pytest.importorskip("viser")
    from balloon_warp.viewer.page import Page
    from balloon_warp.viewer.server import free_port

    obstacles = [
        Obstacle(position=(0.0, -3.0, 0.0), color=(1.0, 0.0, 0.0)),
        Obstacle(shape="capsule", position=(3.0, 0.0, 0.0), motion=[(0.0, (0, 0, 0)), (1.0, (0, 1, 0), (90, 0, 0))]),
    ]
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(3))], obstacle=obstacles)
    page = Page(Session("ball", scene, "cpu", tmp_path), port=free_port("127.0.0.1", 0))
    picture = page.session.picture
    page.layers.draw(picture)
    box, capsule = page.layers.obstacles._meshes
    assert (tuple(box.position), tuple(box.color)) == ((0.0, -3.0, 0.0), (255, 0, 0))
    later = picture.frame.obstacle_poses.copy()
    later[1] = (3.0, 1.0, 0.0, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    page.layers.draw(replace(picture, frame=replace(picture.frame, obstacle_poses=later)))
    np.testing.assert_allclose(capsule.position, (3.0, 1.0, 0.0))
    np.testing.assert_allclose(capsule.wxyz, np.sqrt([0.5, 0.5, 0.0, 0.0]))
    assert tuple(box.position) == (0.0, -3.0, 0.0)
    hits = [
        page.layers.obstacles.hit_distance(np.array([place, 5.0, 0.0]), np.array([0.0, -1.0, 0.0]))
        for place in (0.2, 3.0, 9.0)
    ]
    assert hits == [pytest.approx(7.5), pytest.approx(5.0 - 1.1, abs=1e-3), None]  # the capsule lies now
    ball = quad_sphere(3).points
    expected = [(ball[:, 0].min() + 3.1) / 2, (ball[:, 1].max() - 3.5) / 2, 0.0]  # from ball to capsule and to box
    np.testing.assert_allclose(page.layers.home[1], expected, atol=0.01)
    page.stop()

"""Placement of a balloon, its springs, and its strings."""

from typing import Literal

import numpy as np
import pytest
from meshes import cube, joined, mesh_of, quad_sphere

from balloon_warp.mesh import PolygonMesh
from balloon_warp.model import build_model
from balloon_warp.model.shape import shape_balloon
from balloon_warp.scene import Balloon, Scene, Stiffness, String


def test_rotations_go_about_x_then_y_then_z():
    """Quarter turns of (1, 2, 3) agree with those by hand, after the scale and before the position."""
    mesh = mesh_of([(1, 2, 3), (0, 0, 0), (1, 0, 0)], [[0, 1, 2]])

    def placed(x: float, y: float, z: float) -> list[float]:
        balloon = Balloon(mesh=mesh, rotation=(x, y, z), scale=2.0, position=(10, 20, 30))
        points = shape_balloon(balloon, Scene(balloon=[balloon])).mesh.points
        return ((points[0] - [10, 20, 30]) / 2.0).tolist()

    assert placed(90, 0, 0) == pytest.approx([1, -3, 2], abs=1e-12)
    assert placed(0, 90, 0) == pytest.approx([3, 2, -1], abs=1e-12)
    assert placed(0, 0, 90) == pytest.approx([-2, 1, 3], abs=1e-12)
    assert placed(90, 90, 0) == pytest.approx([2, -3, -1], abs=1e-12)  # y first would give (3, 1, 2)
    assert placed(0, 90, 90) == pytest.approx([-2, 3, -1], abs=1e-12)  # z first would give (3, 1, 2)
    assert placed(90, 90, 90) == pytest.approx([3, 2, -1], abs=1e-12)  # z first would give (3, -1, 2)


def test_the_seed_chooses_the_draws_of_stiffness():
    def scales(seed: int) -> np.ndarray:
        balloon = Balloon(mesh=quad_sphere(3), stiffness=Stiffness(variation=0.5, seed=seed))
        return shape_balloon(balloon, Scene(balloon=[balloon])).stiffness_scale

    np.testing.assert_array_equal(scales(1), scales(1))
    assert np.abs(scales(1) - scales(2)).max() > 0.1  # of 312 draws in a range of 1


def with_stray_vertices(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh after two vertices of no face, far above and far below."""
    return joined(mesh_of([(0, 50, 0), (0, -50, 0)], []), mesh)


@pytest.mark.parametrize(("particle", "height"), [("highest", 1.0), ("lowest", 0.0)])
def test_a_string_holds_a_particle_of_a_face(particle: Literal["highest", "lowest"], height: float):
    mesh = with_stray_vertices(cube())
    scene = Scene(balloon=[Balloon(mesh=mesh)], string=[String(anchor=(0, -2, 0), particle=particle)])
    model = build_model(scene, "cpu")
    held = int(model.string_particle.numpy()[0])
    assert held >= 2
    assert mesh.points[held, 1] == height
    # the length was missing: the distance to that particle
    assert model.parameters["string_length"].numpy()[0, 0] == pytest.approx(
        np.linalg.norm(mesh.points[held] - [0, -2, 0]), rel=1e-6
    )

"""Placement of a balloon, its springs, and its strings."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import trimesh
from meshes import box, cube, joined, mesh_of, quad_sphere

from balloon_warp import Balloon, PolygonMesh, Scene, Stiffness, String, load_scene
from balloon_warp.mesh.thickness import standing
from balloon_warp.mesh.topology import triangulate
from balloon_warp.model import build_model
from balloon_warp.model.shape import shape_balloon


def test_rotations_go_about_x_then_y_then_z():
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


@pytest.mark.parametrize(("particle", "height"), [("highest", 1.0), ("lowest", 0.0)])
def test_a_string_holds_a_particle_of_a_face(particle: Literal["highest", "lowest"], height: float):
    mesh = joined(mesh_of([(0, 50, 0), (0, -50, 0)], []), cube())  # after two vertices of no face
    scene = Scene(balloon=[Balloon(mesh=mesh)], string=[String(anchor=(0, -2, 0), particle=particle)])
    model = build_model(scene, "cpu")
    held = int(model.string_particle.numpy()[0])
    assert held >= 2
    assert mesh.points[held, 1] == height
    # the length was missing: the distance to that particle
    length = np.linalg.norm(mesh.points[held] - [0, -2, 0])
    assert model.parameters["string_length"].numpy()[0, 0] == pytest.approx(length, rel=1e-6)


def figure(up: str) -> PolygonMesh:
    """Return a ball on a flat foot, upright along an axis."""
    foot = box((0.0, 0.0, -1.2), (2.0, 2.0, 0.4))
    ball = quad_sphere(3)
    whole = joined(foot, ball)
    return whole if up == "Z" else replace(whole, points=whole.points[:, [0, 2, 1]] * [1.0, 1.0, -1.0])


BALL, SLAB = quad_sphere(3), box((0.0, 0.0, 0.0), (4.0, 0.2, 3.0))
FOOT, CUSTOM = "which has its widest flat side below", "as by custom in STL files"


@pytest.mark.parametrize(
    ("mesh", "suffix", "expected"),
    [
        pytest.param(figure("Z"), ".stl", ("Z", FOOT), id="a figure that is to be printed"),
        pytest.param(figure("Y"), ".stl", ("Y", FOOT), id="a figure with Y up"),
        pytest.param(figure("Z"), ".ply", ("Z", FOOT), id="a scan with Z up"),
        pytest.param(figure("Y"), ".PLY", ("Y", FOOT), id="a scan with Y up"),
        pytest.param(SLAB, ".stl", ("Y", FOOT), id="a slab lies"),
        pytest.param(box((0, 0, 0), (0.2, 0.2, 4)), ".stl", ("Z", CUSTOM), id="a rod"),
        pytest.param(BALL, ".stl", ("Z", CUSTOM), id="nothing flat"),
        pytest.param(BALL, ".off", None, id="nothing flat, and no custom"),
        pytest.param(figure("Z"), ".obj", None, id="OBJ has Y up by custom"),
        pytest.param(replace(figure("Z"), up_known=True), ".stl", None, id="up is known"),
    ],
)
def test_a_shape_stands_on_its_widest_flat_side(mesh: PolygonMesh, suffix: str, expected: tuple[str, str] | None):
    assert standing(mesh, suffix) == expected


@pytest.mark.parametrize("up", ["Y", "Z"])
def test_a_mesh_by_itself_stands_and_says_why(up: str, tmp_path: Path):
    mesh, path = figure(up), tmp_path / "figure.stl"
    trimesh.Trimesh(mesh.points, triangulate(mesh)[0], process=False).export(path)
    scene = load_scene(path)
    assert (scene.up_axis, scene.balloon[0].up) == (up, up)
    other = "Y" if up == "Z" else "Z"
    assert scene.description.endswith(f"names no up axis, so {up} is up, {FOOT}; --up {other} turns it")
    turned = load_scene(path, {"balloon.up": other})
    assert (turned.up_axis, turned.balloon[0].up) == (other, other)
    assert turned.description.endswith(f"{other} is up, as given")

"""Tunneling of spheres through a balloon, where only particles touch them: a run warns before it begins."""

import re

import numpy as np
import pytest
from conserved import motion
from meshes import cube, quad_sphere
from typer.testing import CliRunner

from balloon_warp.cli.app import app
from balloon_warp.model import plan_model
from balloon_warp.model.tunneling import widest_opening
from balloon_warp.scene import Balloon, Ground, Inflation, Scene, Sphere
from balloon_warp.scene.load import bundled_scenes, load_scene
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics


def test_openings_of_a_cube_and_a_triangle():
    assert widest_opening(cube()) == pytest.approx(np.sqrt(0.5))


@pytest.mark.parametrize("radius", [0.65, 0.75])
def test_a_sphere_that_fits_between_the_corners_of_a_face_passes_untouched(radius, device):
    """A sphere that fits the unit cube's opening of 0.71 m passes through a face, and a larger one moves the cube."""
    still = Balloon(mesh=cube(), inflation=Inflation(k_normal=0.0), damping=0.0)
    sphere = Sphere(position=(0.5, 2.0, 0.5), radius=radius, mass=1.0, velocity=(0.0, -20.0, 0.0))
    scene = Scene(balloon=[still], sphere=[sphere], gravity=0.0, contact="impulse", substeps=40, faces=False)
    simulator = Simulator(scene, device)
    for _ in range(4):
        simulator.step()
    moved = np.abs(motion(simulator)[1]).max() > 0.01
    assert moved == (radius > widest_opening(cube()))


SMALL = [
    (
        0.65,
        r"^sphere 1: its radius of 0\.65 m fits through faces of \w+, even at rest, since only",
    ),
    (
        1.2,
        r"fits through faces of \w+, at a stretch of 1\.7, since only .* edge is 1 m at rest; faces",
    ),
]


@pytest.mark.parametrize(("radius", "sentence"), SMALL)
def test_a_sphere_that_fits_through_a_face_is_named(radius, sentence):
    spheres = [Sphere(position=(9.0, 9.0, 9.0), radius=2.0), Sphere(position=(0.0, 5.0, 0.0), radius=radius)]
    (warning,) = plan_model(Scene(balloon=[Balloon(mesh=cube())], sphere=spheres, gravity=0.0, faces=False)).warnings
    assert re.search(sentence, warning)


def test_the_smallest_sphere_of_all_worlds_counts():
    scene = Scene(balloon=[Balloon(mesh=cube())], sphere=[Sphere(position=(0.0, 5.0, 0.0), radius=2.0)])
    scene = scene.model_copy(update={"gravity": 0.0, "faces": False})
    plan = plan_model(scene, 3, vary={"sphere.0.radius": np.array([2.0, 0.5, 3.0])})
    assert plan.warnings[0].startswith("sphere 0: its radius of 0.5 m fits through")


def test_a_sphere_that_may_jump_over_particles_is_named_unless_its_way_is_looked_along():
    """A sphere that may jump over particles, by 0.33 m in a substep, gives a warning unless its path is swept."""
    scene = Scene(
        balloon=[Balloon(mesh=quad_sphere(8, radius=0.5), position=(0.0, 0.5, 0.0), mass=9.0)],
        sphere=[Sphere(position=(0.0, 80.0, 0.0), radius=0.3)],
        ground=Ground(),
        substeps=2,
        normals="fresh",
    )
    scene = scene.model_copy(update={"gravity": 10.0})
    (warning,) = plan_model(scene).warnings
    assert warning.startswith("sphere 0: may move 0.33 m in a substep, more than its radius of 0.3 m")
    assert plan_model(scene.model_copy(update={"contact": "impulse"})).warnings == []


def test_a_sphere_that_meets_faces_is_not_named():
    sphere = Sphere(position=(0.0, 5.0, 0.0), radius=0.65)
    assert plan_model(Scene(balloon=[Balloon(mesh=cube())], sphere=[sphere], gravity=0.0)).warnings == []


@pytest.mark.full
@pytest.mark.parametrize("name", bundled_scenes())
def test_bundled_scenes_hold_their_spheres(name):
    assert plan_model(load_scene(name)).warnings == []


def test_a_run_says_it(tmp_path):
    scene = tmp_path / "small.toml"
    table = '[[balloon]]\nmesh = "tetrahedron.obj"\n[[sphere]]\nradius = 0.01\nposition = [0.0, 3.0, 0.0]\n'
    scene.write_text(f"frames = 1\nfaces = false\n{table}")
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    (tmp_path / "tetrahedron.obj").write_text(f"{corners}f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    result = CliRunner().invoke(app, ["run", str(scene), "-o", str(tmp_path / "small.usdc"), "--device", "cpu"])
    assert result.exit_code == 0, result.output
    assert "warning: sphere 0: its radius of 0.01 m fits through faces of" in result.output

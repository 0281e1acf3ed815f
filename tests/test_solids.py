"""Mass properties on the device, against trimesh and against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from meshes import cube, fans, joined, open_cube, prism, quad_sphere, torus

from balloon_warp.mesh.placement import place_mesh
from balloon_warp.scene import Balloon, Inflation, Scene
from balloon_warp.scene.load import load_scene
from balloon_warp.simulator import Simulator

MESHES = {"ball": quad_sphere(6), "prism": prism(7), "torus": torus(12, 7), "two": joined(quad_sphere(3), prism(5))}


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
def test_they_are_those_of_trimesh(mesh, device):
    placed = place_mesh(mesh, "Y", 0.3, (20.0, 40.0, 70.0), (5.0, -8.0, 3.0))
    simulator = Simulator(Scene(balloon=[Balloon(mesh=placed)]), device)
    found = simulator.mass_properties()
    expected = fans(placed)
    assert found.closed.tolist() == [True]
    np.testing.assert_allclose(found.volume[0, 0], expected.volume, rtol=1e-5)
    np.testing.assert_allclose(found.center[0, 0], expected.center_mass, rtol=0, atol=1e-6)  # float32 at 8 m
    expected.apply_translation(-expected.center_mass)  # far from the origin trimesh itself loses digits
    scale = np.abs(expected.moment_inertia).max()
    np.testing.assert_allclose(found.inertia[0, 0], expected.moment_inertia, rtol=0, atol=1e-5 * scale)


def test_a_box_has_the_inertia_of_textbooks(device):
    """A box of sides 1, 2 and 3 has the inertia rho V (b^2 + c^2) / 12 about each axis."""
    sides = np.array([1.0, 2.0, 3.0])
    box = cube()
    stretched = replace(box, points=box.points * sides)
    found = Simulator(Scene(balloon=[Balloon(mesh=stretched)]), device).mass_properties()
    assert found.volume[0, 0] == pytest.approx(6.0, rel=1e-12)
    np.testing.assert_allclose(found.center[0, 0], sides / 2.0, rtol=1e-12)
    np.testing.assert_allclose(found.inertia[0, 0], np.diag(6.0 * (14.0 - sides**2) / 12.0), atol=1e-12)


@pytest.mark.full
def test_every_balloon_of_every_world_is_measured_while_it_moves(device):
    closed = Balloon(mesh=quad_sphere(5), helium=20.0, inflation=Inflation(k_normal=0.2))
    scene = Scene(balloon=[closed, Balloon(mesh=open_cube(), position=(4, 0, 0))])
    vary = {"balloon.0.inflation.k_normal": [0.0, 2.0, 2.0]}
    simulator, same = (Simulator(scene, device, 3, vary, "gather") for _ in range(2))
    for _ in range(10):
        simulator.step()
        same.step()
    found, again = simulator.mass_properties(), same.mass_properties()
    assert found.closed.tolist() == [True, False]
    assert found.volume[1, 0] > 1.01 * found.volume[0, 0]
    for name in ("volume", "center", "inertia"):
        np.testing.assert_array_equal(getattr(found, name), getattr(again, name))
        np.testing.assert_array_equal(getattr(found, name)[1], getattr(found, name)[2])
    moved = simulator.state.points.numpy()[1, : simulator.model.particle_offsets[1]]
    mesh = fans(replace(simulator.model.shapes[0].mesh, points=moved.astype(np.float64)))
    np.testing.assert_allclose(found.center[1, 0], mesh.center_mass, atol=1e-6)


def test_a_flat_balloon_has_no_volume_and_no_nan(device):
    simulator = Simulator(Scene(balloon=[Balloon(mesh=cube())]), device)
    flat = cube().points * [1.0, 0.0, 1.0]
    wp.copy(simulator.state.points, wp.array(flat[None], dtype=wp.vec3, device=device))
    found = simulator.mass_properties()
    assert found.volume[0, 0] == 0.0
    assert np.isfinite(found.center).all()
    np.testing.assert_array_equal(found.inertia, 0.0)


def test_bundled_meshes_agree_with_trimesh(device):
    simulator = Simulator(load_scene("squirrel_inflate"), device)
    found, expected = simulator.mass_properties(), fans(simulator.model.shapes[0].mesh)
    np.testing.assert_allclose(found.volume[0, 0], expected.volume, rtol=1e-5)
    np.testing.assert_allclose(found.center[0, 0], expected.center_mass, atol=1e-6)
    scale = np.abs(expected.moment_inertia).max()
    np.testing.assert_allclose(found.inertia[0, 0], expected.moment_inertia, atol=1e-5 * scale)

"""Torsion springs: their rest angle, conservation, and small effect on a balloon."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from meshes import cube, mesh_of, prism, quad_sphere

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.model import build_model, initial_state
from balloon_warp.scene import Balloon, Inflation, Scene, Stiffness, load_scene
from balloon_warp.schedules.readout import ForceReader
from balloon_warp.schedules.scatter import ScatterSchedule
from balloon_warp.simulator import Simulator
from balloon_warp.springs.hinges import build_hinges

pytestmark = pytest.mark.physics

NO_INFLATION = Inflation(k_normal=0.0)
TORSION = Stiffness(structural=0.0, shear=0.0, flexion=0.0, torsion=0.7)
"""torsion springs alone"""


def scene_of(mesh: PolygonMesh, stiffness: Stiffness = TORSION, **fields) -> Scene:
    balloon = Balloon(mesh=mesh, stiffness=stiffness, damping=0.0, inflation=NO_INFLATION)
    return Scene(balloon=[balloon], **({"gravity": 0.0} | fields))


def forces_at(scene: Scene, points: np.ndarray, device: str) -> list[np.ndarray]:
    """Return the forces of scatter, by the velocity after a short step from rest, and of a gathering schedule."""
    model = replace(build_model(scene, device), substeps=1, frame_seconds=1e-3)
    state = initial_state(model)
    wp.copy(state.points, wp.array(points[None], dtype=wp.vec3, device=device))
    gathered = ForceReader(model).net_forces(state).numpy()[0].copy()
    ScatterSchedule(model).advance_frame(state)
    masses = scene.balloon[0].mass * model.shapes[0].mass_share[:, None]
    return [masses * state.velocities.numpy()[0] / model.frame_seconds, gathered]


def energy(mesh: PolygonMesh, points: np.ndarray) -> float:
    """Return the energy 1/2 k (angle - rest angle)^2, summed over the hinges [J]."""
    hinges = build_hinges(mesh)
    bent = hinges.angles(points) - hinges.angles(mesh.points)
    return 0.5 * TORSION.torsion * float((((bent + np.pi) % (2.0 * np.pi) - np.pi) ** 2).sum())


def shaken(mesh: PolygonMesh) -> np.ndarray:
    return mesh.points + np.random.default_rng(3).normal(scale=0.05, size=mesh.points.shape)


MESHES = {"cube": cube(), "n-gons": prism(5), "sphere": quad_sphere(3)}


def test_hinges_are_the_edges_of_two_faces():
    for mesh, count in ((cube(), 12), (prism(5), 15), (quad_sphere(3), 108)):
        assert build_hinges(mesh).count == count
    three_at_an_edge = mesh_of(np.eye(5, 3), [[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    assert build_hinges(three_at_an_edge).count == 0
    np.testing.assert_allclose(np.abs(build_hinges(cube()).angles(cube().points)), np.pi / 2.0)


@pytest.mark.full
@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
def test_forces_are_the_slope_of_the_energy(mesh: PolygonMesh, device: str):
    points, step = shaken(mesh), 1e-6
    slope = np.zeros_like(points)
    for particle, axis in np.ndindex(points.shape):
        aside = np.zeros_like(points)
        aside[particle, axis] = step
        slope[particle, axis] = (energy(mesh, points + aside) - energy(mesh, points - aside)) / (2.0 * step)
    for forces in forces_at(scene_of(mesh), points, device):
        assert np.abs(slope).max() > 0.1
        np.testing.assert_allclose(forces, -slope, atol=2e-5 * np.abs(slope).max())


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
def test_forces_have_neither_a_sum_nor_a_moment(mesh: PolygonMesh, device: str):
    points = shaken(mesh)
    for forces in forces_at(scene_of(mesh), points, device):
        atol = 1e-5 * np.abs(forces).max()
        np.testing.assert_allclose(forces.sum(axis=0), 0.0, atol=atol)
        np.testing.assert_allclose(np.cross(points, forces).sum(axis=0), 0.0, atol=atol)


def test_a_fold_that_is_pushed_through_itself_comes_back_the_short_way(device):
    """The moment of two triangles folded past shut is continuous, though the angle jumps by a whole turn."""
    edge, open_by = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], np.radians(5.0)

    def fold(half: float) -> np.ndarray:
        wings = [[0.5, np.cos(half), np.sin(half)], [0.5, np.cos(half), -np.sin(half)]]
        return np.array([*edge, *wings])

    mesh = mesh_of(fold(open_by), [[0, 1, 2], [1, 0, 3]])
    for forces in forces_at(scene_of(mesh), fold(-0.5 * open_by), device):
        moment = TORSION.torsion * 3.0 * open_by  # from 5 to -2.5 degrees on either side, 1 m from the edge
        np.testing.assert_allclose(np.linalg.norm(forces[2:], axis=1), moment, rtol=2e-5)  # pi rounded, over 0.13
        assert forces[2, 2] > 0.0 > forces[3, 2]


def test_at_rest_there_is_no_force(device):
    for forces in forces_at(scene_of(quad_sphere(3)), 2.0 * quad_sphere(3).points + [1.0, 2.0, 3.0], device):
        np.testing.assert_allclose(forces, 0.0, atol=1e-5)


def test_autos_step_is_stable_and_six_times_that_is_not(device):
    """Energy of torsion springs alone is bounded at the automatic step and blows up at six times that."""
    mesh = quad_sphere(4)
    substeps = Simulator(scene_of(mesh), "cpu").model.substeps
    assert substeps > 3
    speeds = []
    for seconds, count in ((60.0, substeps), (60.0 / 6.0, substeps)):
        scene = scene_of(mesh, frames_per_second=60.0, substeps=substeps)
        model = replace(build_model(scene, device), frame_seconds=1.0 / seconds, substeps=count)
        simulator = Simulator.of_model(model)
        shake = np.random.default_rng(1).normal(scale=1e-3, size=mesh.points.shape)
        wp.copy(simulator.state.velocities, wp.array(shake[None], dtype=wp.vec3, device=device))
        for _ in range(30):
            simulator.advance()
        speeds.append(np.abs(simulator.state.velocities.numpy()).max())
    assert speeds[0] < 1e-2
    assert not speeds[1] < 1e-1


@pytest.mark.full
def test_torsion_springs_hardly_change_a_balloon(device):
    """Torsion springs change the volume of the squirrel by about a hundredth where they are stiff enough to shorten the
    time step, as the paper finds."""
    ends = []
    for torsion in (0.0, 0.02):
        scene = load_scene("squirrel_inflate", [("balloon.stiffness.torsion", torsion), ("frames", 110)])
        simulator = Simulator(scene, device)
        for _ in range(scene.frames):
            simulator.step()
        points = simulator.read_frame().points[0].astype(np.float64)
        ends.append((simulator.model.substeps, replace(simulator.model.shapes[0].mesh, points=points)))
    (substeps, plain), (substeps_with_torsion, stiff) = ends
    assert substeps_with_torsion > substeps
    assert signed_volume(stiff) == pytest.approx(signed_volume(plain), rel=0.02)

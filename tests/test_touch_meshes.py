"""Contact of odd meshes: open ones, lines, polygons, coarse and fine ones together."""

import numpy as np
import pytest
from meshes import fans, grid, mesh_of, moebius, prism, quad_sphere, torus
from overlaps import deepest
from touching import RADIUS, SLACK, VACUUM, ball, centers, run, touching

from balloon_warp.scene import Balloon, Inflation, Scene, Touch
from balloon_warp.schedules.touch_table import triangles_of
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_open_surface_stops_what_comes_from_either_side(side, device):
    sheet = grid(8, 8)
    sheet = mesh_of(0.25 * (sheet.points - (4.0, 4.0, 0.0)), sheet.face_vertex_indices.reshape(-1, 4).tolist())
    border = np.flatnonzero(np.abs(sheet.points).max(axis=1) == 1.0).tolist()
    firm = Inflation(pressure=20.0)
    coming = ball(0.0, 0.0, 0.6 * side, velocity=(0.0, 0.0, -2.0 * side), inflation=firm)
    held = Balloon(mesh=sheet, fixed=border, mass=0.2, inflation=SLACK)
    simulator = Simulator(Scene(balloon=[held, coming], touch=Touch(), **VACUUM), device)
    touched = 0
    for _ in range(60):
        simulator.step()
        touched = max(touched, touching(simulator))
    assert touched > 20
    assert side * centers(simulator)[1, 2] > 0.6


@pytest.mark.full
def test_a_chain_lies_on_a_ball(device):
    """A chain lies on a ball: its particles touch, and nothing touches its edges, which have no surface."""
    chain = mesh_of([(x, 0.0, 0.0) for x in np.linspace(-0.2, 0.2, 9)], [[n, n + 1] for n in range(8)])
    falling = Balloon(mesh=chain, position=(0.0, 0.7, 0.0), velocity=(0.0, -2.0, 0.0), mass=0.02, inflation=SLACK)
    scene = Scene(balloon=[falling, ball(0.0, 0.0, 0.0)], touch=Touch(itself=True), **VACUUM)
    simulator = run(scene, device, "gather", 20)
    points = simulator.state.points.numpy()[0, :9]
    assert np.linalg.norm(points - centers(simulator)[1], axis=1).min() > 0.95 * RADIUS


@pytest.mark.full
@pytest.mark.parametrize("mesh", [moebius(12), prism(7), torus(12, 6)], ids=["moebius", "prism", "torus"])
def test_what_surfaces_there_are_stay_finite_and_slow(mesh, device):
    """Two of each open surface thrown at each other stay finite, and nothing gets faster than both were."""
    balls = [
        Balloon(mesh=mesh, damping=0.0, inflation=SLACK),
        Balloon(mesh=mesh, position=(0.3, 0.9, 0.1), velocity=(0.0, -2.0, 0.0), damping=0.0, inflation=SLACK),
    ]
    simulator = Simulator(Scene(balloon=balls, touch=Touch(itself=True), **VACUUM), device)
    touched = 0
    for _ in range(40):
        simulator.step()
        touched = max(touched, touching(simulator))
    assert touched > 0
    assert np.abs(simulator.state.velocities.numpy()).max() < 4.0


@pytest.mark.parametrize("fine_above", [True, False])
def test_a_coarse_and_a_fine_ball_touch(fine_above, device):
    """Balls of 98 and 1,538 particles bounce: the fine one rests on large triangles, and pushes their few corners."""
    meshes = [quad_sphere(4, RADIUS), quad_sphere(16, RADIUS)]
    lower, upper = meshes if fine_above else meshes[::-1]
    firm = Inflation(pressure=15.0)
    balls = [
        ball(0.0, 0.0, 0.0, mesh=lower, inflation=firm, damping=0.3),
        ball(0.0, 1.2, 0.0, mesh=upper, inflation=firm, damping=0.3, velocity=(0.0, -1.0, 0.0)),
    ]
    simulator = Simulator(Scene(balloon=balls, touch=Touch(), **VACUUM), device)
    touched, deep = 0, 0.0
    for frame in range(60):
        simulator.step()
        touched = max(touched, touching(simulator))
        if frame % 5 == 0:
            deep = max(deep, deepest(simulator))
    assert touched > 10
    assert deep < 0.02 * RADIUS + sagitta(meshes[0])


def sagitta(mesh) -> float:
    """Return the largest height of a quad over its diagonal [m]: faces are not flat, and a fan is not two triangles."""
    quads = mesh.points[mesh.face_vertex_indices.reshape(-1, 4)]
    return float(np.linalg.norm(0.5 * (quads[:, 0] + quads[:, 2]) - 0.5 * (quads[:, 1] + quads[:, 3]), axis=1).max())


@pytest.mark.parametrize("mesh", [quad_sphere(3), prism(7), grid(3, 2)], ids=["quads", "heptagons", "open"])
def test_triangles_have_the_faces_area_and_side(mesh):
    """Triangles have the area and side of the faces, in the order of their corners."""
    triangles = triangles_of(mesh)
    assert len(triangles) == int((mesh.face_vertex_counts - 2).sum())
    for part in (1.0, -0.5):  # seen from two places, they have the volume of the faces' fans, about
        found, expected = (volume(each - part) for each in (mesh.points[triangles], fans(mesh).triangles))
        assert found == pytest.approx(expected, rel=0.1, abs=1e-12)


def volume(triangles) -> float:
    """Return the signed volume of the cones from the origin [m^3]."""
    return float(np.linalg.det(triangles).sum() / 6.0)

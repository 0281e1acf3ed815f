"""Paper's inflation: 100 k_normal (A_p / A_total) n, cached or fresh, following its keyframes."""

import numpy as np
import pytest
from meshes import cube, grid, quad_sphere

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import face_areas, face_centers, triangulate, vertex_normals
from balloon_warp.scene import Balloon, Inflation, Scene, Stiffness
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

NO_SPRINGS = Stiffness(structural=0.0, shear=0.0, flexion=0.0)


def inflating(mesh, k_normal, **fields) -> Scene:
    balloon = Balloon(mesh=mesh, stiffness=NO_SPRINGS, damping=0.0, inflation=Inflation(k_normal=k_normal))
    return Scene(**{"balloon": [balloon], "gravity": 0.0, "substeps": 4} | fields)


def forces_at_start(scene: Scene, device: str) -> np.ndarray:
    return Simulator(scene, device).read_frame(net_forces=True).inflation_forces[0]


def test_a_cube_corner_is_pushed_along_its_diagonal(device):
    """A cube's corner is pushed along (1, 1, 1) / sqrt(3) with a sixth of the area."""
    mesh = cube()
    outward = np.sign(mesh.points - mesh.points.mean(axis=0)) / np.sqrt(3.0)
    forces = forces_at_start(inflating(mesh, 0.3), device)
    np.testing.assert_allclose(forces, 100.0 * 0.3 / 6.0 * outward, rtol=1e-5)


def test_force_is_the_formula_on_an_uneven_open_mesh(device):
    """The force is that of the definition in float64: the nearest incident face's area, the mean unit normal."""
    mesh = grid(4, 3)
    mesh.points[:] += np.random.default_rng(0).uniform(-0.3, 0.3, mesh.points.shape)
    areas, centers, normals = face_areas(mesh), face_centers(mesh), vertex_normals(mesh)
    faces = mesh.face_vertex_indices.reshape(-1, 4)
    expected = np.empty((mesh.vertex_count, 3))
    for particle in range(mesh.vertex_count):
        incident = np.flatnonzero((faces == particle).any(axis=1))
        nearest = incident[np.linalg.norm(centers[incident] - mesh.points[particle], axis=1).argmin()]
        expected[particle] = 100.0 * 0.7 * areas[nearest] / areas.sum() * normals[particle]
    np.testing.assert_allclose(forces_at_start(inflating(mesh, 0.7), device), expected, rtol=1e-4, atol=1e-5)


def test_k_normal_follows_its_keyframes(device):
    """Keyframes are interpolated linearly, and constant outside: inflate, hold, deflate."""
    keyframes = [[0.1, 0.0], [0.3, 0.6], [0.5, 0.6], [0.6, -0.2]]
    simulator = Simulator(inflating(cube(), keyframes, frames_per_second=50, frames=40), device)
    times, values = np.array(keyframes).T
    for frame in range(1, 41):
        simulator.step()
        force = np.linalg.norm(simulator.read_frame().inflation_forces[0][0])
        expected = 100.0 * abs(np.interp(frame / 50.0, times, values)) / 6.0
        # the particle drifts by millimeters meanwhile: its share of the area by less than a hundredth
        np.testing.assert_allclose(force, expected, rtol=0.01, atol=1e-3)


def test_momentum_follows_the_ramp_within_a_frame(device):
    """A particle's speed is the sum of h F / m over the substeps, F following the ramp substep by substep."""
    simulator = Simulator(inflating(cube(), [[0.0, 0.0], [0.02, 1.0]], frames_per_second=50, substeps=5), device)
    simulator.step()
    speed = np.linalg.norm(simulator.read_frame().velocities[0], axis=1)
    h, mass, ramp = 0.02 / 5, 0.1 / 8, np.arange(5) / 5.0
    np.testing.assert_allclose(speed, h * (100.0 / 6.0 * ramp / mass).sum(), rtol=1e-5)


def test_cached_normals_stay_for_a_frame_and_fresh_ones_follow(device):
    """Cached and fresh normals agree in the first substep, and differ later as the particle moves."""
    mesh = quad_sphere(3)
    mesh.points[:, 0] *= 1.5  # normals turn as it grows: on the round sphere they would not

    def points(normals: str, substeps: int) -> np.ndarray:
        simulator = Simulator(inflating(mesh, 2.0, normals=normals, substeps=substeps, frames_per_second=10), device)
        simulator.step()
        return simulator.read_frame().points[0]

    # other kernels aim them, which round otherwise: by some 1e-7 of places 20 m apart
    np.testing.assert_allclose(points("cached", 1), points("fresh", 1), atol=20 * 1e-6)
    assert np.abs(points("cached", 8) - points("fresh", 8)).max() > 1e-3


def in_triangles(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with each quad in two triangles."""
    corners, _ = triangulate(mesh)
    counts = np.full(len(corners), 3, dtype=np.int32)
    return PolygonMesh(points=mesh.points, face_vertex_counts=counts, face_vertex_indices=corners.ravel())


def push(mesh: PolygonMesh, inflation: Inflation, device: str) -> float:
    """Return the sum of forces along the radius of a round ball [N]."""
    balloon = Balloon(mesh=mesh, stiffness=NO_SPRINGS, damping=0.0, inflation=inflation)
    forces = forces_at_start(Scene(balloon=[balloon], gravity=0.0, substeps=4), device)
    return float((forces * mesh.points).sum())


@pytest.mark.full
@pytest.mark.parametrize("cells", [4, 12])
def test_k_normal_means_half_as_much_on_triangles_and_a_pressure_the_same(cells, device):
    """A particle is pushed by the area of its nearest face: there are as many quads as particles, so that together they
    push by nearly 100 k_normal; and twice as many triangles, of half the area. A pressure pushes by its area."""
    quads = quad_sphere(cells)
    meshes = quads, in_triangles(quads)
    pushes = [push(mesh, Inflation(k_normal=1.0), device) for mesh in meshes]
    assert 90.0 < pushes[0] < 100.0
    assert 44.0 < pushes[1] < 52.0
    by_pressure = [push(mesh, Inflation(pressure=10.0), device) for mesh in meshes]
    assert by_pressure[1] == pytest.approx(by_pressure[0], rel=0.02)  # the same ball, but for its facets

"""Contact of one particle with one triangle: geometry and forces."""

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from balloon_warp.benchmarks.overlap import distances
from balloon_warp.kernels.laws.touch import touch_energy, touch_friction, touch_push
from balloon_warp.kernels.loops.meeting import Place, Touching, faced, is_nearer, place_beside, touch
from balloon_warp.kernels.options import OPTIONS

wp.set_module_options(OPTIONS)


@wp.kernel(enable_backward=False)
def find_gaps(
    points: wp.array[wp.vec3],
    corners: wp.array2d[wp.vec3],
    gaps: wp.array[float],
    squares: wp.array[float],
    nearest: wp.array[wp.vec3],
):
    """Return the gap of each point beside the nearest of all triangles."""
    number = wp.tid()
    best = Place()
    best.squared = 1.0e30
    for triangle in range(corners.shape[0]):
        a, b, c = corners[triangle, 0], corners[triangle, 1], corners[triangle, 2]
        place = place_beside(points[number], a, b, c)
        if is_nearer(place, best):
            best = faced(place, a, b, c)
            nearest[number] = place.weights[0] * a + place.weights[1] * b + place.weights[2] * c
    gaps[number] = best.gap
    squares[number] = best.squared


def beside(points: NDArray, corners: NDArray, device: str) -> tuple[NDArray, NDArray, NDArray]:
    """Return gaps [m], squared distances [m^2] and closest points [m]."""
    count = len(points)
    found = [wp.zeros(count, dtype=dtype, device=device) for dtype in (float, float, wp.vec3)]
    inputs = [wp.array(np.asarray(part), dtype=wp.vec3, device=device) for part in (points, corners)]
    wp.launch(find_gaps, count, inputs, found, device=device)
    gaps, squares, nearest = (array.numpy().astype(np.float64) for array in found)
    return gaps, squares, nearest


def test_the_nearest_point_of_a_triangle_is_found(device):
    """The closest point of a triangle is found from all around it, beside faces, edges and corners."""
    random = np.random.default_rng(1)
    triangle = random.normal(size=(1, 3, 3))
    points = random.normal(size=(500, 3)) * 2.0
    gaps, squares, nearest = beside(points, triangle, device)
    expected = [float(distances(point, triangle)[0]) for point in points]
    np.testing.assert_allclose(np.sqrt(squares), expected, rtol=1e-5)
    np.testing.assert_allclose(np.abs(gaps), expected, rtol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(points - nearest, axis=1), expected, rtol=1e-5, atol=1e-6)


def test_a_sharp_edge_knows_on_which_side_a_particle_is(device):
    """A particle over the edge of a wedge is outside, though behind one of its faces; in either order."""
    left = [(0.0, 0.0, -1.0), (-0.2, -1.0, 0.0), (0.0, 0.0, 1.0)]
    right = [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (0.2, -1.0, 0.0)]
    points = [(0.05, 0.1, 0.0), (-0.05, 0.1, 0.0), (0.0, -0.1, 0.0)]
    outward = np.cross(np.subtract(left[1], left[0]), np.subtract(left[2], left[0]))
    assert outward[0] < 0.0
    for corners in ([left, right], [right, left]):
        gaps, _, _ = beside(points, corners, device)
        assert (gaps[:2] > 0.1).all()
        assert gaps[2] < 0.0


def test_triangles_without_size_have_a_nearest_point(device):
    """Distances to degenerate triangles are those to a segment: corners at one place, two of them, or all on a line."""
    a, b, c = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0)
    points = np.array([a, b, (0.5, 0.0, 0.0), (0.3, 0.4, 0.0), (9.0, 9.0, 9.0)])
    for corners in ((a, a, a), (a, a, b), (a, b, a), (b, a, a), (a, b, c), (c, a, b)):
        ends = np.min(corners, axis=0), np.max(corners, axis=0)
        expected = np.linalg.norm(points - np.clip(points, *ends), axis=1)
        gaps, squares, nearest = beside(points, [corners], device)
        np.testing.assert_allclose(np.sqrt(squares), expected, rtol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(points - nearest, axis=1), expected, rtol=1e-6)
        assert np.isfinite(gaps).all()


def test_corners_on_a_line_in_any_direction_have_a_nearest_point(device):
    """Distances to a triangle whose corners rounding alone keeps off a line are those to its longest edge, to 1e-3.

    A needle counts as a line up to an angle of 1e-3 between its edges, and a point may be as far off.
    """
    random = np.random.default_rng(3)
    for _ in range(40):
        way = random.normal(size=3)
        places = np.sort(random.uniform(-1.0, 1.0, 3))
        ends = places[[0, 2], None] * way
        corners = random.permutation(places)[:, None] * way
        points = random.normal(size=(16, 3))
        along = np.clip((points - ends[0]) @ (ends[1] - ends[0]) / np.sum((ends[1] - ends[0]) ** 2), 0.0, 1.0)
        expected = np.linalg.norm(points - ends[0] - along[:, None] * (ends[1] - ends[0]), axis=1)
        _, squares, _ = beside(points, [tuple(map(tuple, corners))], device)
        np.testing.assert_allclose(np.sqrt(squares), expected, rtol=1e-3)


@wp.kernel(enable_backward=False)
def push_and_hold(overlaps: wp.array[float], pushes: wp.array[float], energies: wp.array[float]):
    """Store the push and energy of contacts of 100 N/m at rest."""
    number = wp.tid()
    pushes[number] = touch_push(overlaps[number], 0.0, 100.0, 0.001)
    energies[number] = touch_energy(overlaps[number], 100.0)


def test_the_push_is_what_its_energy_loses(device):
    overlaps = np.linspace(-0.01, 0.02, 61)
    given = wp.array(overlaps, dtype=float, device=device)
    pushes, energies = (wp.zeros(61, dtype=float, device=device) for _ in range(2))
    wp.launch(push_and_hold, 61, [given], [pushes, energies], device=device)
    slopes = np.gradient(energies.numpy().astype(np.float64), overlaps)
    inner = np.abs(overlaps) > 1e-3  # it begins at 0
    np.testing.assert_allclose(
        np.where(inner, pushes.numpy(), 0.0)[1:-1], np.where(inner, slopes, 0.0)[1:-1], atol=1e-5
    )


@wp.kernel(enable_backward=False)
def rub(slips: wp.array[wp.vec3], slides: wp.array[wp.vec3], pulls: wp.array[wp.vec3], left: wp.array[wp.vec3]):
    """Store the friction of contacts pressed with 2 N, with coefficient 0.5 and 100 N/m."""
    number = wp.tid()
    pull, slip = touch_friction(slips[number], slides[number], 1.0, 100.0, 0.001)
    pulls[number] = pull
    left[number] = slip


def test_friction_stays_in_its_cone(device):
    """Friction stays within its cone: it opposes slip, and slip beyond the cone is released."""
    slips, slides = [(0.001, 0.0, 0.0), (0.5, 0.0, 0.0), (0.0, 0.0, 0.0)], [(0, 0, 0), (0, 0, 0), (50.0, 0.0, 0.0)]
    inputs = [wp.array(rows, dtype=wp.vec3, device=device) for rows in (slips, slides)]
    outputs = [wp.zeros(3, dtype=wp.vec3, device=device) for _ in range(2)]
    wp.launch(rub, 3, inputs, outputs, device=device)
    pulls, left = (array.numpy() for array in outputs)
    np.testing.assert_allclose(pulls[:, 0], [-0.1, -1.0, -1.0], rtol=1e-5)
    np.testing.assert_allclose(left[:, 0], [0.001, 0.01, 0.0], rtol=1e-5)


@wp.kernel(enable_backward=False)
def meet(
    points: wp.array[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    side: float,
    forces: wp.array2d[wp.vec3],
):
    """Store the forces of a particle beside one triangle, in a skin of 0.5 m, where it has slipped; on a side of it."""
    number = wp.tid()
    a = wp.vec3(0.0, 0.0, 0.0)
    b = wp.vec3(1.0, 0.1, 0.0)
    c = wp.vec3(0.2, 0.9, 0.1)
    inputs = Touching()
    inputs.side = side
    place = faced(place_beside(points[number], a, b, c), a, b, c)
    inputs.thickness = 0.5
    inputs.stiffness = 100.0
    inputs.friction = 0.7
    inputs.masses = wp.vec4(1.0, 2.0, 3.0, 4.0)
    inputs.first = True
    inputs.step_seconds = 0.001
    v = velocities[number]
    pushes = touch(
        inputs, place, wp.vec4(0.1, -0.2, 0.05, 9.0 * side), v[0],
        wp.matrix_from_rows(a, b, c), wp.matrix_from_rows(v[1], v[2], v[3]),
    )  # fmt: skip
    forces[number, 0] = -(pushes.a + pushes.b + pushes.c)
    forces[number, 1] = pushes.a
    forces[number, 2] = pushes.b
    forces[number, 3] = pushes.c


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["in_front", "behind"])
def test_forces_of_a_contact_have_no_torque(side, device):
    """Contact forces with friction have no net torque about any point, beside the face, its edges and its corners, on
    either side of a sheet."""
    random = np.random.default_rng(2)
    points = random.uniform((-0.3, -0.3, -0.3), (1.1, 1.1, 0.4), size=(400, 3)) * (1.0, 1.0, side)
    velocities = random.normal(size=(400, 4, 3))
    forces = wp.zeros((400, 4), dtype=wp.vec3, device=device)
    given = [wp.array(rows, dtype=wp.vec3, device=device) for rows in (points, velocities)]
    wp.launch(meet, 400, [*given, side], [forces], device=device)
    found = forces.numpy().astype(np.float64)
    corners = np.array([(0.0, 0.0, 0.0), (1.0, 0.1, 0.0), (0.2, 0.9, 0.1)])
    arms = np.concatenate([points[:, None], np.broadcast_to(corners, (400, 3, 3))], axis=1)
    torques = np.cross(arms, found).sum(axis=1)
    sizes = np.abs(found).max(axis=(1, 2))
    assert (sizes > 1.0).sum() > 300
    assert np.abs(torques).max() < 1e-5 * sizes.max()

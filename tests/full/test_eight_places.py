"""Eight triangles that are measured side by side on a CPU, and each by itself: the same to the bit."""

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.contact.triangles import find_places, place_of
from balloon_warp.kernels.lanes import LANE_COUNT, LaneNumbers
from balloon_warp.kernels.loops.contact import Place, place_beside
from balloon_warp.kernels.working import EightPlaces

wp.set_module_options(OPTIONS)
EIGHT = int(LANE_COUNT)


@wp.func
def put_place(
    found: wp.array3d[float],
    way: wp.int32,
    triangle: wp.int32,
    place: Place,  # pyright: ignore[reportGeneralTypeIssues] - a struct
):
    """Store all numbers of a place."""
    for axis in range(3):
        found[way, triangle, axis] = place.weights[axis]
        found[way, triangle, 3 + axis] = place.arm[axis]
        found[way, triangle, 6 + axis] = place.area_vector[axis]
    found[way, triangle, 9] = place.squared


@wp.kernel(enable_backward=False)
def measure_both_ways(
    points: wp.array[wp.vec3],
    corners: wp.array[wp.vec3],
    triangles: wp.array[wp.vec3i],
    places: wp.array[EightPlaces],
    found: wp.array3d[float],
):
    """Measure each eight triangles beside their point, side by side and one by one."""
    row = wp.tid()
    numbers = LaneNumbers()
    for lane in range(LANE_COUNT):
        numbers[lane] = LANE_COUNT * row + lane
    find_places(corners, triangles, numbers, points[row], places)
    for lane in range(LANE_COUNT):
        triangle = triangles[numbers[lane]]
        put_place(found, 0, numbers[lane], place_of(places, lane))
        put_place(
            found, 1, numbers[lane],
            place_beside(points[row], corners[triangle[0]], corners[triangle[1]], corners[triangle[2]]),
        )  # fmt: skip


def both_ways(points: NDArray, corners: NDArray) -> NDArray:
    """Return ten numbers of each triangle, (2, triangles, 10), by each way."""
    count = len(corners)
    arrays = [wp.array(part.reshape(-1, 3), dtype=wp.vec3, device="cpu") for part in (points, corners)]
    triangles = wp.array(np.arange(3 * count).reshape(-1, 3), dtype=wp.vec3i, device="cpu")
    places, found = wp.zeros(1, EightPlaces, device="cpu"), wp.zeros((2, count, 10), float, device="cpu")
    wp.launch(measure_both_ways, count // EIGHT, [*arrays, triangles, places, found], device="cpu")
    return found.numpy()


@pytest.mark.parametrize("size", [1e-4, 1.0, 1e4])
@pytest.mark.parametrize("width", [1.0, 1e-3, 1e-6, 0.0])
def test_eight_triangles_side_by_side_are_measured_as_one(width: float, size: float):
    """Needles at all angles, too, and points all around: the nearest point is inside, on edges, and in each corner."""
    draw = np.random.default_rng(8)
    rows = 600
    corners = draw.normal(size=(rows, EIGHT, 3, 3))
    along = corners[..., 1, :] - corners[..., 0, :]
    corners[..., 2, :] = corners[..., 0, :] + draw.uniform(-1.0, 2.0, (rows, EIGHT, 1)) * along + width * draw.normal(
        size=(rows, EIGHT, 3)
    )  # fmt: skip
    points = draw.normal(size=(rows, 3)) * draw.choice([0.3, 1.0, 4.0], (rows, 1))
    found = both_ways(size * points, size * corners.reshape(-1, 3, 3))
    np.testing.assert_array_equal(found[0], found[1])
    kinds = {tuple(row) for row in found[0, :, :3] > 0.0}
    ends = [tuple(np.arange(3) == corner) for corner in range(3)]
    assert kinds >= {*ends, (True, True, False)}
    assert (True, True, True) in kinds or width < 1.0  # hardly ever inside of a needle


def test_corners_at_one_place_are_measured_as_one():
    """Triangles without size, points on corners and on planes, and zeros of either sign give the same numbers."""
    a, b, c, d = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 1.0, -0.0)
    eight = np.array([(a, a, a), (a, a, b), (a, b, a), (b, a, a), (a, b, c), (c, a, b), (a, b, d), (d, a, c)])
    points = np.array([a, b, d, (0.5, 0.0, 0.0), (0.3, 0.4, 0.0), (-0.0, -1.0, 0.0), (9.0, 9.0, 9.0)])
    found = both_ways(points, np.concatenate([eight] * len(points)))
    assert np.isfinite(found).all()
    np.testing.assert_array_equal(found[0], found[1])

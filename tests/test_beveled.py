"""Boxes with round edges, as obstacles and bodies are drawn."""

import numpy as np
import pytest

from balloon_warp.mesh.geometry import face_vector_areas, signed_volume, vertex_normals
from balloon_warp.mesh.topology import is_closed, mesh_edges
from balloon_warp.outputs.beveled import OF_LARGEST, OF_LEAST, beveled_box


@pytest.mark.parametrize("half", [(0.5, 0.5, 0.5), (1.0, 0.04, 1.0), (0.01, 3.0, 0.2), (1e-3, 1e-3, 1.0)])
def test_a_box_is_as_large_as_it_is_simulated_with_round_edges(half: tuple[float, float, float]):
    sides = np.array(half)
    box, normals = beveled_box(sides)
    assert is_closed(mesh_edges(box))
    np.testing.assert_allclose([-box.points.min(axis=0), box.points.max(axis=0)], np.tile(sides, (2, 1)), rtol=1e-9)
    # Faces look outward and are flat but for the edges, whose radius is some of the sides.
    radius = 2.0 * min(OF_LARGEST * sides.max(), OF_LEAST * sides.min())
    corner = box.points[np.argmax(box.points.sum(axis=1))]
    np.testing.assert_allclose(sides - corner, radius * (1.0 - 1.0 / np.sqrt(3.0)), rtol=1e-6)
    flat = (np.abs(np.abs(box.points) - sides) < 1e-9 * sides.max()).any(axis=1)
    assert np.abs(normals[flat]).max(axis=1) == pytest.approx(1.0)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)
    assert np.einsum("ij,ij->i", vertex_normals(box), normals).min() > 0.98
    areas = np.linalg.norm(face_vector_areas(box), axis=1)
    assert areas.min() > 0.0
    assert 0.7 * 8.0 * sides.prod() < signed_volume(box) < 8.0 * sides.prod()

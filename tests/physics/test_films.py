"""Membrane faces as blocks compute them, area vectors included, which otherwise happens on a GPU alone."""

from dataclasses import replace

import numpy as np
import pytest
from lone_films import QUADS, TRIANGLES, measured, moved

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume


@pytest.mark.always("mesh1-1", "mesh3-0")
@pytest.mark.parametrize(("mesh", "held"), [(QUADS, 0), (QUADS, 1), (QUADS, 2), (TRIANGLES, 0)])
def test_area_vectors_are_the_gradient_of_the_volume(mesh: PolygonMesh, held: int) -> None:
    """Area vectors equal central differences of the volume, exact but for rounding: it is cubic in each place."""
    points = moved(mesh, 1.0)
    _, found = measured(mesh, points, held)
    np.testing.assert_allclose(found, gradient(mesh, points.astype(np.float64)), atol=1e-7)


@pytest.mark.always
@pytest.mark.parametrize("held", [1, 2])
@pytest.mark.parametrize("stretch", [0.9, 1.1, 1.6], ids=["slack", "wrinkled here and there", "taut"])
def test_quads_pull_alike_whether_threads_keep_them(stretch: float, held: int) -> None:
    """Forces of quads agree whether or not threads keep their data, up to float32's rounding; and they sum to zero."""
    points = moved(QUADS, stretch)
    kept, read = (measured(QUADS, points, each)[0] for each in (held, 0))
    largest = np.abs(read).max()
    assert largest > 0.0
    np.testing.assert_allclose(kept, read, atol=2e-5 * largest)
    np.testing.assert_allclose(kept.sum(axis=0), 0.0, atol=1e-5 * largest)


def gradient(mesh: PolygonMesh, points: np.ndarray, step: float = 1e-4) -> np.ndarray:
    """Return the gradient of the enclosed volume by each place [m^2]."""
    found = np.zeros_like(points)
    for place in np.ndindex(*points.shape):
        for sign in (1.0, -1.0):
            moved = points.copy()
            moved[place] += sign * step
            found[place] += sign * signed_volume(replace(mesh, points=moved)) / (2.0 * step)
    return found

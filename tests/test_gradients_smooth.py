"""Gradients averaged over worlds that differ by a little, against the Gaussian integrals of a ball in free flight."""

from math import erf, exp, pi, sqrt
from typing import Any

import numpy as np
import pytest
from meshes import quad_sphere

import balloon_warp as bw
from balloon_warp.batch.simulate import Trajectories

SECONDS, DEVIATION, JUMP, AT = 0.1, 0.2, 0.05, 0.1
PATH = "balloon.velocity.0"


def flying() -> bw.Scene:
    ball = bw.Balloon(
        mesh=quad_sphere(2, 0.2), mass=0.1, damping=0.0, velocity=(1.0, 0.0, 0.0), inflation=bw.Inflation(pressure=10.0)
    )
    return bw.Scene(balloon=[ball], gravity=0.0, frames=6, substeps=4)


def squared_way(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
    """Return the square of the way, and more beyond a place: of that jump the gradient knows nothing."""
    way, slopes = moved.points[0][:, -1, :, 0].mean(axis=1), np.zeros(moved.points[0].shape)
    slopes[:, -1, :, 0] = 2.0 * way[:, None] / moved.points[0].shape[2]
    return way**2 + JUMP * (way > AT), {"points": [slopes]}


def test_means_over_samples_are_those_of_a_normal_distribution():
    """Quantiles of 64 samples find the integrals of the loss to 1e-4, of its slope to 2 %: their variance is 1 % less
    than 1, and the jump lies between two of them."""
    speeds = np.array([1.0, 2.0])
    found = bw.gradient(
        flying(), of=[PATH], loss=squared_way, world_count=2, vary={PATH: speeds}, smooth={PATH: DEVIATION}, samples=64,
        device="cpu",
    )  # fmt: skip
    off = [(speed - AT / SECONDS) / DEVIATION for speed in speeds]
    jumps = np.array([JUMP * 0.5 * (1.0 + erf(each / sqrt(2.0))) for each in off])
    densities = np.array([JUMP * exp(-(each**2) / 2.0) / (DEVIATION * sqrt(2.0 * pi)) for each in off])
    smooth_part = 2.0 * SECONDS**2 * speeds
    np.testing.assert_allclose(found.loss, SECONDS**2 * (speeds**2 + DEVIATION**2) + jumps, atol=1e-4)
    np.testing.assert_allclose(found.gradients[PATH], smooth_part, rtol=1e-5)
    np.testing.assert_allclose(found.slopes[PATH], smooth_part + densities, rtol=0.02)
    assert found.errors[PATH] == pytest.approx(2.0 * SECONDS**2 * DEVIATION / 8.0, rel=0.02)
    assert found.by_points[0].shape == (2, 26, 3)
    assert found.trajectories.points[0].shape[0] == 128


def test_one_world_has_no_dimension_for_worlds_and_two_paths_scatter_apart():
    paths = {PATH: DEVIATION, "balloon.mass": 0.01}
    found = bw.gradient(flying(), of=[PATH], loss=squared_way, smooth=paths, samples=8, device="cpu")
    assert (found.loss.shape, found.by_points[0].shape, set(found.slopes)) == ((1,), (26, 3), set(paths))
    ways = found.trajectories.points[0][:, -1, :, 0].mean(axis=1)
    assert len(np.unique(ways.round(6))) == 8
    assert abs(found.slopes["balloon.mass"][0]) < 0.05 / 0.01  # in free flight only chance ties it to the mass


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        ({"smooth": {PATH: 0.0}}, r"smooth: balloon.velocity.0: expected a standard deviation above 0 \(got 0\)"),
        ({"smooth": {PATH: 0.1}, "samples": 1}, r"samples: expected at least 2 \(got 1\)"),
        ({"smooth": {"balloon.mas": 0.1}}, "balloon.0.mas: unknown field; did you mean mass"),
        ({"smooth": {"balloon.mass": 0.1}}, "balloon.0.mass: must be greater than 0"),
    ],
    ids=["deviation", "samples", "path", "bound"],
)
def test_bad_smoothing_is_refused(asked: dict[str, Any], sentence: str):
    with pytest.raises(bw.InputError, match=sentence):
        bw.gradient(flying(), of=[PATH], loss=squared_way, device="cpu", **asked)

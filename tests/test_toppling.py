"""Stability of an equilibrium of a balloon."""

from dataclasses import dataclass

import numpy as np
import pytest
import scipy.sparse as sparse

from balloon_warp.statics.toppling import rigid_motions, toppling_mode

pytestmark = pytest.mark.physics

POINTS = np.random.default_rng(0).standard_normal((8, 3))
SOFT = 5
"""Coordinate of the least stiffness"""


@dataclass(frozen=True)
class Held:
    """Balance of held particles, each coordinate with a spring of its own."""

    stiffness_of_soft: float
    squeeze: float = 0.0
    loading: bool = True

    def stiffness(self, points: np.ndarray):
        each = np.ones(points.size)
        each[SOFT] = self.stiffness_of_soft
        return sparse.diags(each).tocsc(), np.eye(points.size)[SOFT], self.squeeze


@pytest.mark.parametrize(
    ("soft", "squeeze", "topples"), [(-0.01, 0.0, True), (0.01, 0.0, False), (-0.01, 0.02, False), (-0.01, 0.005, True)]
)
def test_a_balloon_topples_where_a_stiffness_is_negative(soft: float, squeeze: float, topples: bool):
    """The mode is that of the negative stiffness; gas that resists it makes the balance stable."""
    mode = toppling_mode(Held(soft, squeeze), POINTS)  # pyright: ignore
    assert (mode is not None) == topples
    if mode is not None:
        np.testing.assert_allclose(np.abs(mode.ravel()), np.eye(POINTS.size)[SOFT], atol=1e-6)


def test_rigid_motions_keep_distances():
    """Six orthonormal motions change the distances of all points to second order alone."""
    motions = rigid_motions(POINTS)
    np.testing.assert_allclose(motions.T @ motions, np.eye(6), atol=1e-12)
    apart = POINTS[:, None] - POINTS[None]
    for motion in motions.T:
        moved = motion.reshape(-1, 3)
        np.testing.assert_allclose(((moved[:, None] - moved[None]) * apart).sum(axis=2), 0.0, atol=1e-12)
